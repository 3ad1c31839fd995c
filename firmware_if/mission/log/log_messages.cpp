#include "firmware_if/mission/log/log_messages.hpp"

#include <acfrlcm/auv_vis_rawlog_t.hpp>
#include <algorithm>
#include <cmath>
#include <fathom/attitude_t.hpp>
#include <fathom/battery_t.hpp>
#include <fathom/depth_t.hpp>
#include <fathom/dvl_t.hpp>
#include <fathom/gps_t.hpp>
#include <fathom/gyro_t.hpp>
#include <fathom/image_t.hpp>
#include <fathom/progress_t.hpp>
#include <fathom/raw_t.hpp>
#include <fathom/usbl_t.hpp>
#include <fathom/water_t.hpp>
#include <senlcm/parosci_t.hpp>
#include <senlcm/tcm_t.hpp>
#include <senlcm/usbl_fix_t.hpp>
#include <utility>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/log/checked_message.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::string_view kUsblPrefix = "USBL_FIX.";
constexpr std::string_view kRawPrefix = "RAW_";

// Rounded down, before 1970 too.
std::int64_t toMicroseconds(std::int64_t ns) {
  return ns / kMicrosecond_ns - (ns % kMicrosecond_ns < 0 ? 1 : 0);
}

constexpr std::size_t kImageNameAt = 8 + 8 + 8 + 1, kImageRest = 8 + 4;
constexpr std::size_t kRawSizeAt = 8 + 8, kRawRest = 4;
constexpr std::size_t kVisNameAt = 8 + 8, kVisRest = 4;

// Copies a member `s` of a sample to the member `m` of its message; `has` marks an absent value.
struct ToMessage {
  template <class M, class S>
  void operator()(M& m, const S& s) const {
    m = static_cast<M>(s);
  }
  void operator()(std::int8_t& has, double& m, const std::optional<double>& s) const {
    has = s ? 1 : 0;
    m = s.value_or(0.0);
  }
  void operator()(std::int8_t& has, double (&m)[3], const std::optional<Eigen::Vector3d>& s) const {
    has = s ? 1 : 0;
    Eigen::Vector3d::Map(m) = s.value_or(Eigen::Vector3d::Zero());
  }
};
// The inverse.
struct ToSample {
  template <class M, class S>
  void operator()(const M& m, S& s) const {
    s = static_cast<S>(m);
  }
  template <class M, class S>
  void operator()(std::int8_t has, const M& m, std::optional<S>& s) const {
    if (has != 0) s = S(m);
  }
};

// For each kind of sample: its message, its channel, and members(), which calls copy(m.member, s.member) for
// each member besides utc_ns. `copy` is a ToMessage or a ToSample, so that each member is named once for both
// directions.
template <class Sample>
struct Coded;
template <>
struct Coded<DvlSample> {
  using Message = dvl_t;
  static constexpr std::string_view kChannel = "RDI";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.has_velocity, m.velocity, s.velocity);
    for (std::size_t i = 0; i < 4; ++i) copy(m.has_range[i], m.range[i], s.range[i]);
    copy(m.has_altitude, m.altitude, s.altitude);
    copy(m.sound_speed, s.sound_speed);
  }
};
template <>
struct Coded<AttitudeSample> {
  using Message = attitude_t;
  static constexpr std::string_view kChannel = "FATHOM_ATTITUDE";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.roll, s.roll);
    copy(m.pitch, s.pitch);
    copy(m.heading, s.heading);
    copy(m.magnetic, s.magnetic);
  }
};
template <>
struct Coded<GyroSample> {
  using Message = gyro_t;
  static constexpr std::string_view kChannel = "FATHOM_GYRO";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.has_body_rate, m.body_rate, s.body_rate);
    copy(m.has_heading_rate, m.heading_rate, s.heading_rate);
  }
};
template <>
struct Coded<DepthSample> {
  using Message = depth_t;
  static constexpr std::string_view kChannel = "FATHOM_DEPTH";
  static void members(auto copy, auto& m, auto& s) { copy(m.depth, s.depth); }
};
template <>
struct Coded<UsblFix> {
  using Message = usbl_t;
  static constexpr std::string_view kChannel = "FATHOM_USBL";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.fix_arrival_utc_ns, s.arrival_utc_ns);
    copy(m.latitude, s.latitude);
    copy(m.longitude, s.longitude);
    copy(m.depth, s.depth);
    copy(m.sigma_horizontal, s.sigma_horizontal);
  }
};
template <>
struct Coded<GpsFix> {
  using Message = gps_t;
  static constexpr std::string_view kChannel = "FATHOM_GPS";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.latitude, s.latitude);
    copy(m.longitude, s.longitude);
    copy(m.sigma_horizontal, s.sigma_horizontal);
  }
};
template <>
struct Coded<WaterSample> {
  using Message = water_t;
  static constexpr std::string_view kChannel = "FATHOM_WATER";
  static void members(auto copy, auto& m, auto& s) {
    std::size_t i = 0;
    for (auto* value :
         {&s.conductivity, &s.temperature, &s.sound_speed, &s.chlorophyll, &s.cdom, &s.turbidity}) {
      copy(m.has_value[i], m.value[i], *value);
      ++i;
    }
  }
};
template <>
struct Coded<BatterySample> {
  using Message = battery_t;
  static constexpr std::string_view kChannel = "FATHOM_BATTERY";
  static void members(auto copy, auto& m, auto& s) {
    copy(m.has_value[0], m.value[0], s.voltage);
    copy(m.has_value[1], m.value[1], s.current);
    copy(m.has_value[2], m.value[2], s.charge);
  }
};
template <>
struct Coded<MissionProgressSample> {
  using Message = progress_t;
  static constexpr std::string_view kChannel = "FATHOM_PROGRESS";
  static bool canBe(const progress_t& m) { return m.fraction >= 0 && m.fraction <= 1; }
  static void members(auto copy, auto& m, auto& s) { copy(m.fraction, s.fraction); }
};
template <>
struct Coded<ImageEvent> {
  using Message = image_t;
  static constexpr std::string_view kChannel = "FATHOM_IMAGE";
  static bool lengthsFit(std::span<const std::uint8_t> data) {
    return lengthFits(data, kImageNameAt, kImageRest);
  }
  static bool canBe(const image_t& m) {
    return (m.side == 0 || m.side == 1) && plainFileName(m.file_name) &&
           m.file_name.size() <= FileName::kMost;
  }
  static void members(auto copy, auto& m, auto& s) {
    copy(m.side, s.side);
    copy(m.file_name, s.file_name);
    copy(m.exposure, s.exposure_s);
  }
};

template <class Sample>
std::optional<DecodedSample> decodeAs(std::span<const std::uint8_t> data) {
  using C = Coded<Sample>;
  typename C::Message m = {};
  if constexpr (requires { C::lengthsFit(data); })
    if (!C::lengthsFit(data)) return std::nullopt;
  if (!decodeWhole(data, m)) return std::nullopt;
  if constexpr (requires { C::canBe(m); })
    if (!C::canBe(m)) return std::nullopt;
  Sample s;
  s.utc_ns = m.utc_ns;
  C::members(ToSample{}, std::as_const(m), s);
  return DecodedSample{m.arrival_utc_ns, s};
}

using Decode = std::optional<DecodedSample> (*)(std::span<const std::uint8_t>);

template <class Sample>
constexpr std::pair<std::string_view, Decode> kDecoderOf = {Coded<Sample>::kChannel, decodeAs<Sample>};

// nullptr for a channel that carries no sample.
Decode sampleDecoder(std::string_view channel) {
  static constexpr std::pair<std::string_view, Decode> kDecoders[] = {
      kDecoderOf<DvlSample>,   kDecoderOf<AttitudeSample>, kDecoderOf<GyroSample>,
      kDecoderOf<DepthSample>, kDecoderOf<UsblFix>,        kDecoderOf<GpsFix>,
      kDecoderOf<WaterSample>, kDecoderOf<BatterySample>,  kDecoderOf<MissionProgressSample>,
      kDecoderOf<ImageEvent>};
  static_assert(std::size(kDecoders) == std::variant_size_v<SensorSample>);
  for (const auto& [name, decode] : kDecoders)
    if (name == channel) return decode;
  return nullptr;
}

// ns of an ACFR utime; std::nullopt beyond int64.
std::optional<std::int64_t> toNanoseconds(std::int64_t utime) {
  std::int64_t ns = 0;
  if (__builtin_mul_overflow(utime, kMicrosecond_ns, &ns)) return std::nullopt;
  return ns;
}

std::optional<SensorSample> acfrSample(std::string_view channel, std::span<const std::uint8_t> data) {
  if (channel == "TCM") {
    senlcm::tcm_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = toNanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return AttitudeSample{*utc_ns, m.roll, m.pitch, m.heading, true};
  }
  if (channel == "PAROSCI") {
    senlcm::parosci_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = toNanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return DepthSample{*utc_ns, m.depth};
  }
  if (channel.substr(0, kUsblPrefix.size()) == kUsblPrefix) {
    senlcm::usbl_fix_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = toNanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return UsblFix{*utc_ns, *utc_ns, m.latitude, m.longitude, m.depth, m.accuracy};
  }
  acfrlcm::auv_vis_rawlog_t m = {};
  if (!lengthFits(data, kVisNameAt, kVisRest) || !decodeWhole(data, m)) return std::nullopt;
  const auto utc_ns = toNanoseconds(m.utime);
  const auto name = parseImageFileName(m.image_name);
  if (!utc_ns || !name) return std::nullopt;
  return ImageEvent{*utc_ns, name->side, m.image_name, m.exp_time / kMicrosecondsPerSecond};
}

}  // namespace

LogMessage encodeSample(std::int64_t arrival_utc_ns, const SensorSample& sample) {
  return std::visit(
      [arrival_utc_ns]<class Sample>(const Sample& s) -> LogMessage {
        typename Coded<Sample>::Message m = {};
        m.arrival_utc_ns = arrival_utc_ns;
        m.utc_ns = s.utc_ns;
        Coded<Sample>::members(ToMessage{}, m, s);
        return {std::string(Coded<Sample>::kChannel), encodeChecked(m)};
      },
      sample);
}

std::optional<LogMessage> encodeAcfrTwin(const SensorSample& sample, const std::string& vehicle_name) {
  if (const auto* attitude = std::get_if<AttitudeSample>(&sample)) {
    if (!attitude->magnetic) return std::nullopt;  // TCM is a magnetic compass
    senlcm::tcm_t m = {};
    m.utime = toMicroseconds(attitude->utc_ns);
    m.heading = attitude->heading;
    m.roll = attitude->roll;
    m.pitch = attitude->pitch;
    return LogMessage{"TCM", encodePlain(m)};
  }
  if (const auto* depth = std::get_if<DepthSample>(&sample)) {
    senlcm::parosci_t m = {};
    m.utime = toMicroseconds(depth->utc_ns);
    m.depth = depth->depth;
    return LogMessage{"PAROSCI", encodePlain(m)};
  }
  if (const auto* fix = std::get_if<UsblFix>(&sample)) {
    senlcm::usbl_fix_t m = {};
    m.utime = toMicroseconds(fix->utc_ns);
    m.latitude = fix->latitude;
    m.longitude = fix->longitude;
    m.depth = fix->depth;
    m.accuracy = fix->sigma_horizontal;
    return LogMessage{std::string(kUsblPrefix) + vehicle_name, encodePlain(m)};
  }
  if (const auto* image = std::get_if<ImageEvent>(&sample)) {
    acfrlcm::auv_vis_rawlog_t m = {};
    m.utime = toMicroseconds(image->utc_ns);
    m.image_name = image->file_name;
    m.exp_time = static_cast<std::int32_t>(
        std::clamp(std::round(image->exposure_s * kMicrosecondsPerSecond), 0.0, 2147483647.0));
    return LogMessage{"ACFR_AUV_VIS_RAWLOG", encodePlain(m)};
  }
  return std::nullopt;
}

std::vector<std::uint8_t> encodeRaw(std::int64_t arrival_utc_ns, std::span<const std::uint8_t> bytes) {
  raw_t m = {};
  m.arrival_utc_ns = arrival_utc_ns;
  m.size = static_cast<std::int32_t>(bytes.size());
  m.data.assign(bytes.begin(), bytes.end());
  return encodeChecked(m);
}

ChannelKind channelKind(std::string_view channel) {
  if (sampleDecoder(channel) != nullptr) return ChannelKind::kSample;
  if (channel == "TCM" || channel == "PAROSCI" || channel == "ACFR_AUV_VIS_RAWLOG" ||
      channel.substr(0, kUsblPrefix.size()) == kUsblPrefix)
    return ChannelKind::kAcfr;
  if (channel.substr(0, kRawPrefix.size()) == kRawPrefix) return ChannelKind::kRaw;
  return ChannelKind::kOther;
}

std::optional<DecodedSample> decodeSample(std::string_view channel, std::span<const std::uint8_t> data) {
  const Decode decode = sampleDecoder(channel);
  return decode != nullptr && checkHolds(data) ? decode(data) : std::nullopt;
}

std::optional<DecodedSample> decodeAcfr(std::string_view channel, std::int64_t timestamp_us,
                                        std::span<const std::uint8_t> data) {
  const auto sample = acfrSample(channel, data);
  const auto arrival = toNanoseconds(timestamp_us);
  if (!sample || !arrival) return std::nullopt;
  return DecodedSample{*arrival, *sample};
}

std::optional<RawBytes> decodeRaw(std::span<const std::uint8_t> data) {
  raw_t m = {};
  if (!checkHolds(data) || !lengthFits(data, kRawSizeAt, kRawRest) || !decodeWhole(data, m))
    return std::nullopt;
  return RawBytes{m.arrival_utc_ns, data.subspan(kRawSizeAt + 4, data.size() - kRawSizeAt - 4 - kRawRest)};
}

}  // namespace fathom::io

#include "firmware_if/log/log_messages.hpp"

#include <acfrlcm/auv_vis_rawlog_t.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
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

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/log/checked_message.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kNanosecondsPerMicrosecond = 1000;
constexpr double kMicrosecondsPerSecond = 1e6;
constexpr std::string_view kUsblPrefix = "USBL_FIX.";
constexpr std::string_view kRawPrefix = "RAW_";

// Rounded down, before 1970 too.
std::int64_t microseconds(std::int64_t ns) {
  return ns / kNanosecondsPerMicrosecond - (ns % kNanosecondsPerMicrosecond < 0 ? 1 : 0);
}

constexpr std::size_t kImageNameAt = 8 + 8 + 8 + 1, kImageRest = 8 + 4;
constexpr std::size_t kRawSizeAt = 8 + 8, kRawRest = 4;
constexpr std::size_t kVisNameAt = 8 + 8, kVisRest = 4;

struct Encoder {
  std::int64_t arrival_utc_ns;

  LogMessage operator()(const DvlSample& s) const {
    dvl_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.has_velocity = s.velocity ? 1 : 0;
    for (int i = 0; i < 3; ++i) m.velocity[i] = s.velocity ? (*s.velocity)(i) : 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      m.has_range[i] = s.range[i] ? 1 : 0;
      m.range[i] = s.range[i].value_or(0.0);
    }
    m.has_altitude = s.altitude ? 1 : 0;
    m.altitude = s.altitude.value_or(0.0);
    m.sound_speed = s.sound_speed;
    return {"RDI", encodeChecked(m)};
  }
  LogMessage operator()(const AttitudeSample& s) const {
    attitude_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.roll = s.roll;
    m.pitch = s.pitch;
    m.heading = s.heading;
    m.magnetic = s.magnetic ? 1 : 0;
    return {"FATHOM_ATTITUDE", encodeChecked(m)};
  }
  LogMessage operator()(const GyroSample& s) const {
    gyro_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.has_body_rate = s.body_rate ? 1 : 0;
    for (int i = 0; i < 3; ++i) m.body_rate[i] = s.body_rate ? (*s.body_rate)(i) : 0.0;
    m.has_heading_rate = s.heading_rate ? 1 : 0;
    m.heading_rate = s.heading_rate.value_or(0.0);
    return {"FATHOM_GYRO", encodeChecked(m)};
  }
  LogMessage operator()(const DepthSample& s) const {
    depth_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.depth = s.depth;
    return {"FATHOM_DEPTH", encodeChecked(m)};
  }
  LogMessage operator()(const UsblFix& s) const {
    usbl_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.fix_arrival_utc_ns = s.arrival_utc_ns;
    m.latitude = s.latitude;
    m.longitude = s.longitude;
    m.depth = s.depth;
    m.sigma_horizontal = s.sigma_horizontal;
    return {"FATHOM_USBL", encodeChecked(m)};
  }
  LogMessage operator()(const GpsFix& s) const {
    gps_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.latitude = s.latitude;
    m.longitude = s.longitude;
    m.sigma_horizontal = s.sigma_horizontal;
    return {"FATHOM_GPS", encodeChecked(m)};
  }
  LogMessage operator()(const WaterSample& s) const {
    water_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    const std::array<const std::optional<double>*, 6> values = {
        &s.conductivity, &s.temperature, &s.sound_speed, &s.chlorophyll, &s.cdom, &s.turbidity};
    for (std::size_t i = 0; i < values.size(); ++i) {
      m.has_value[i] = values[i]->has_value() ? 1 : 0;
      m.value[i] = values[i]->value_or(0.0);
    }
    return {"FATHOM_WATER", encodeChecked(m)};
  }
  LogMessage operator()(const BatterySample& s) const {
    battery_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    const std::array<const std::optional<double>*, 3> values = {&s.voltage, &s.current, &s.charge};
    for (std::size_t i = 0; i < values.size(); ++i) {
      m.has_value[i] = values[i]->has_value() ? 1 : 0;
      m.value[i] = values[i]->value_or(0.0);
    }
    return {"FATHOM_BATTERY", encodeChecked(m)};
  }
  LogMessage operator()(const MissionProgressSample& s) const {
    progress_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.fraction = s.fraction;
    return {"FATHOM_PROGRESS", encodeChecked(m)};
  }
  LogMessage operator()(const ImageEvent& s) const {
    image_t m = {};
    m.arrival_utc_ns = arrival_utc_ns;
    m.utc_ns = s.utc_ns;
    m.side = static_cast<std::int8_t>(s.side);
    m.file_name = s.file_name;
    m.exposure = s.exposure_s;
    return {"FATHOM_IMAGE", encodeChecked(m)};
  }
};

std::optional<DecodedSample> decodeDvl(std::span<const std::uint8_t> data) {
  dvl_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  DvlSample s;
  s.utc_ns = m.utc_ns;
  if (m.has_velocity != 0) s.velocity = Eigen::Vector3d(m.velocity[0], m.velocity[1], m.velocity[2]);
  for (std::size_t i = 0; i < 4; ++i)
    if (m.has_range[i] != 0) s.range[i] = m.range[i];
  if (m.has_altitude != 0) s.altitude = m.altitude;
  s.sound_speed = m.sound_speed;
  return DecodedSample{m.arrival_utc_ns, s};
}

std::optional<DecodedSample> decodeAttitude(std::span<const std::uint8_t> data) {
  attitude_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  return DecodedSample{m.arrival_utc_ns,
                       AttitudeSample{m.utc_ns, m.roll, m.pitch, m.heading, m.magnetic != 0}};
}

std::optional<DecodedSample> decodeGyro(std::span<const std::uint8_t> data) {
  gyro_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  GyroSample s;
  s.utc_ns = m.utc_ns;
  if (m.has_body_rate != 0) s.body_rate = Eigen::Vector3d(m.body_rate[0], m.body_rate[1], m.body_rate[2]);
  if (m.has_heading_rate != 0) s.heading_rate = m.heading_rate;
  return DecodedSample{m.arrival_utc_ns, s};
}

std::optional<DecodedSample> decodeDepth(std::span<const std::uint8_t> data) {
  depth_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  return DecodedSample{m.arrival_utc_ns, DepthSample{m.utc_ns, m.depth}};
}

std::optional<DecodedSample> decodeUsbl(std::span<const std::uint8_t> data) {
  usbl_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  return DecodedSample{m.arrival_utc_ns, UsblFix{m.utc_ns, m.fix_arrival_utc_ns, m.latitude, m.longitude,
                                                 m.depth, m.sigma_horizontal}};
}

std::optional<DecodedSample> decodeGps(std::span<const std::uint8_t> data) {
  gps_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  return DecodedSample{m.arrival_utc_ns, GpsFix{m.utc_ns, m.latitude, m.longitude, m.sigma_horizontal}};
}

std::optional<DecodedSample> decodeWater(std::span<const std::uint8_t> data) {
  water_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  WaterSample s;
  s.utc_ns = m.utc_ns;
  const std::array<std::optional<double>*, 6> values = {&s.conductivity, &s.temperature, &s.sound_speed,
                                                        &s.chlorophyll,  &s.cdom,        &s.turbidity};
  for (std::size_t i = 0; i < values.size(); ++i)
    if (m.has_value[i] != 0) *values[i] = m.value[i];
  return DecodedSample{m.arrival_utc_ns, s};
}

std::optional<DecodedSample> decodeBattery(std::span<const std::uint8_t> data) {
  battery_t m = {};
  if (!decodeWhole(data, m)) return std::nullopt;
  BatterySample s;
  s.utc_ns = m.utc_ns;
  const std::array<std::optional<double>*, 3> values = {&s.voltage, &s.current, &s.charge};
  for (std::size_t i = 0; i < values.size(); ++i)
    if (m.has_value[i] != 0) *values[i] = m.value[i];
  return DecodedSample{m.arrival_utc_ns, s};
}

std::optional<DecodedSample> decodeProgress(std::span<const std::uint8_t> data) {
  progress_t m = {};
  if (!decodeWhole(data, m) || !(m.fraction >= 0 && m.fraction <= 1)) return std::nullopt;
  return DecodedSample{m.arrival_utc_ns, MissionProgressSample{m.utc_ns, m.fraction}};
}

std::optional<DecodedSample> decodeImage(std::span<const std::uint8_t> data) {
  image_t m = {};
  if (!lengthFits(data, kImageNameAt, kImageRest) || !decodeWhole(data, m)) return std::nullopt;
  if ((m.side != 0 && m.side != 1) || !plainFileName(m.file_name) || m.file_name.size() > FileName::kMost)
    return std::nullopt;
  return DecodedSample{m.arrival_utc_ns,
                       ImageEvent{m.utc_ns, static_cast<CameraSide>(m.side), m.file_name, m.exposure}};
}

struct SampleChannel {
  std::string_view name;
  std::optional<DecodedSample> (*decode)(std::span<const std::uint8_t>);
};
constexpr std::array<SampleChannel, 10> kSampleChannels = {{{"RDI", decodeDvl},
                                                            {"FATHOM_ATTITUDE", decodeAttitude},
                                                            {"FATHOM_GYRO", decodeGyro},
                                                            {"FATHOM_DEPTH", decodeDepth},
                                                            {"FATHOM_USBL", decodeUsbl},
                                                            {"FATHOM_GPS", decodeGps},
                                                            {"FATHOM_WATER", decodeWater},
                                                            {"FATHOM_BATTERY", decodeBattery},
                                                            {"FATHOM_PROGRESS", decodeProgress},
                                                            {"FATHOM_IMAGE", decodeImage}}};

// ns of an ACFR utime; std::nullopt beyond int64.
std::optional<std::int64_t> nanoseconds(std::int64_t utime) {
  std::int64_t ns = 0;
  if (__builtin_mul_overflow(utime, kNanosecondsPerMicrosecond, &ns)) return std::nullopt;
  return ns;
}

std::optional<SensorSample> acfrSample(std::string_view channel, std::span<const std::uint8_t> data) {
  if (channel == "TCM") {
    senlcm::tcm_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = nanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return AttitudeSample{*utc_ns, m.roll, m.pitch, m.heading, true};
  }
  if (channel == "PAROSCI") {
    senlcm::parosci_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = nanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return DepthSample{*utc_ns, m.depth};
  }
  if (channel.substr(0, kUsblPrefix.size()) == kUsblPrefix) {
    senlcm::usbl_fix_t m = {};
    if (!decodeWhole(data, m)) return std::nullopt;
    const auto utc_ns = nanoseconds(m.utime);
    if (!utc_ns) return std::nullopt;
    return UsblFix{*utc_ns, *utc_ns, m.latitude, m.longitude, m.depth, m.accuracy};
  }
  acfrlcm::auv_vis_rawlog_t m = {};
  if (!lengthFits(data, kVisNameAt, kVisRest) || !decodeWhole(data, m)) return std::nullopt;
  const auto utc_ns = nanoseconds(m.utime);
  const auto name = parseImageFileName(m.image_name);
  if (!utc_ns || !name) return std::nullopt;
  return ImageEvent{*utc_ns, name->side, m.image_name, m.exp_time / kMicrosecondsPerSecond};
}

}  // namespace

LogMessage encodeSample(std::int64_t arrival_utc_ns, const SensorSample& sample) {
  return std::visit(Encoder{arrival_utc_ns}, sample);
}

std::optional<LogMessage> encodeAcfrTwin(const SensorSample& sample, const std::string& vehicle_name) {
  if (const auto* attitude = std::get_if<AttitudeSample>(&sample)) {
    if (!attitude->magnetic) return std::nullopt;  // TCM is a magnetic compass
    senlcm::tcm_t m = {};
    m.utime = microseconds(attitude->utc_ns);
    m.heading = attitude->heading;
    m.roll = attitude->roll;
    m.pitch = attitude->pitch;
    return LogMessage{"TCM", encodePlain(m)};
  }
  if (const auto* depth = std::get_if<DepthSample>(&sample)) {
    senlcm::parosci_t m = {};
    m.utime = microseconds(depth->utc_ns);
    m.depth = depth->depth;
    return LogMessage{"PAROSCI", encodePlain(m)};
  }
  if (const auto* fix = std::get_if<UsblFix>(&sample)) {
    senlcm::usbl_fix_t m = {};
    m.utime = microseconds(fix->utc_ns);
    m.latitude = fix->latitude;
    m.longitude = fix->longitude;
    m.depth = fix->depth;
    m.accuracy = fix->sigma_horizontal;
    return LogMessage{std::string(kUsblPrefix) + vehicle_name, encodePlain(m)};
  }
  if (const auto* image = std::get_if<ImageEvent>(&sample)) {
    acfrlcm::auv_vis_rawlog_t m = {};
    m.utime = microseconds(image->utc_ns);
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
  for (const SampleChannel& known : kSampleChannels)
    if (channel == known.name) return ChannelKind::kSample;
  if (channel == "TCM" || channel == "PAROSCI" || channel == "ACFR_AUV_VIS_RAWLOG" ||
      channel.substr(0, kUsblPrefix.size()) == kUsblPrefix)
    return ChannelKind::kAcfr;
  if (channel.substr(0, kRawPrefix.size()) == kRawPrefix) return ChannelKind::kRaw;
  return ChannelKind::kOther;
}

std::optional<DecodedSample> decodeSample(std::string_view channel, std::span<const std::uint8_t> data) {
  if (!checkHolds(data)) return std::nullopt;
  for (const SampleChannel& known : kSampleChannels)
    if (channel == known.name) return known.decode(data);
  return std::nullopt;
}

std::optional<DecodedSample> decodeAcfr(std::string_view channel, std::int64_t timestamp_us,
                                        std::span<const std::uint8_t> data) {
  const auto sample = acfrSample(channel, data);
  const auto arrival = nanoseconds(timestamp_us);
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

#include "firmware_if/devices/lcm/lcm_source.hpp"

#include <arpa/inet.h>
#include <lcm/lcm.h>
#include <poll.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <exception>
#include <mutex>
#include <numbers>
#include <sstream>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kLongestLcmWait_ns = 64 * kSecond_ns;
constexpr const char* kLcmNotJoined =
    "cannot be opened; give udpm://239.255.76.67:7667?ttl=0, and where the machine has no network, run: ip "
    "route add 239.255.76.67/32 dev lo";
constexpr const char* kNoLoopback =
    "does not receive its own messages; look at the machine's routes and firewall";

void handOver(const lcm_recv_buf_t* received, const char* channel, void* receiver) {
  static_cast<LcmBus::Receiver*>(receiver)->message(
      channel, {static_cast<const std::uint8_t*>(received->data), received->data_size});
}

// Whether the url names a provider of liblcm and, for udpm, a multicast address; its options are left to
// liblcm.
bool isLcmUrl(std::string_view url) {
  constexpr std::array<std::string_view, 5> kOthers = {"memq://", "file://", "tcpq://", "mpudpm://",
                                                       "udpm://"};
  const bool known = std::any_of(kOthers.begin(), kOthers.end(),
                                 [&](std::string_view provider) { return url.starts_with(provider); });
  if (!known || !url.starts_with("udpm://")) return known;
  const std::string network(url.substr(7, url.find('?') == url.npos ? url.npos : url.find('?') - 7));
  if (network.empty()) return true;  // liblcm's default
  const std::size_t colon = network.find(':');
  in_addr group = {};
  if (::inet_pton(AF_INET, network.substr(0, colon).c_str(), &group) != 1 ||
      !IN_MULTICAST(ntohl(group.s_addr)))
    return false;
  if (colon == network.npos) return true;
  int port = 0;
  const char* const end = network.data() + network.size();
  const auto parsed = std::from_chars(network.data() + colon + 1, end, port);
  return parsed.ec == std::errc{} && parsed.ptr == end && port > 0 && port <= 65535;
}

// In the order of SensorSample.
constexpr std::array<std::string_view, kDeviceKinds> kSampleWords = {
    "dvl", "attitude", "depth", "usbl", "gps", "water", "battery", "progress", "gyro"};
constexpr std::array<const char*, kDeviceKinds> kSampleChannels = {
    "RDI",          "FATHOM_ATTITUDE", "FATHOM_DEPTH",    "FATHOM_USBL", "FATHOM_GPS",
    "FATHOM_WATER", "FATHOM_BATTERY",  "FATHOM_PROGRESS", "FATHOM_GYRO"};
// A ship's fix has crossed the water, and perhaps waited for its turn.
constexpr double kMaxFixAge_s = 300;
constexpr std::int64_t kTwinsFor_ns = 10 * kSecond_ns;   // after a fathom message its ACFR twins are left out
constexpr double kDeepest_m = 12000, kFastest_mps = 20;  // nothing in the sea is beyond
constexpr double kFastestTurn_radps = 10;

struct Plausible {
  static bool angle(double a) { return std::abs(a) <= 4 * std::numbers::pi; }
  static bool place(double latitude, double longitude) {
    return std::abs(latitude) <= std::numbers::pi / 2 && std::abs(longitude) <= 2 * std::numbers::pi;
  }
  static bool within(const std::optional<double>& v, double min, double max) {
    return !v || (*v >= min && *v <= max);
  }
  bool operator()(const DvlSample& s) const {
    for (const auto& range : s.range)
      if (!within(range, 0, kDeepest_m)) return false;
    return (!s.velocity || (s.velocity->array().abs() <= kFastest_mps).all()) &&
           within(s.altitude, 0, kDeepest_m) && s.sound_speed >= 1300 && s.sound_speed <= 1700;
  }
  bool operator()(const AttitudeSample& s) const {
    return angle(s.roll) && angle(s.pitch) && angle(s.heading);
  }
  bool operator()(const GyroSample& s) const {
    return (s.body_rate || s.heading_rate) &&
           (!s.body_rate || (s.body_rate->array().abs() <= kFastestTurn_radps).all()) &&
           within(s.heading_rate, -kFastestTurn_radps, kFastestTurn_radps);
  }
  bool operator()(const DepthSample& s) const { return std::abs(s.depth) <= kDeepest_m; }
  bool operator()(const UsblFix& s) const {
    return place(s.latitude, s.longitude) && std::abs(s.depth) <= kDeepest_m && s.sigma_horizontal >= 0 &&
           s.sigma_horizontal <= kDeepest_m;
  }
  bool operator()(const GpsFix& s) const {
    return place(s.latitude, s.longitude) && s.sigma_horizontal >= 0 && s.sigma_horizontal <= kDeepest_m;
  }
  bool operator()(const WaterSample& s) const {
    return within(s.conductivity, 0, 10) && within(s.temperature, -5, 50) &&
           within(s.sound_speed, 1300, 1700) && within(s.chlorophyll, -10, 1e4) &&
           within(s.cdom, -100, 1e5) && within(s.turbidity, -10, 1e3);
  }
  bool operator()(const BatterySample& s) const {
    return within(s.voltage, 0, 2000) && within(s.current, -1e4, 1e4) && within(s.charge, 0, 1);
  }
  bool operator()(const MissionProgressSample& s) const { return s.fraction >= 0 && s.fraction <= 1; }
  bool operator()(const ImageEvent&) const { return false; }  // cameras are not on the bus
};

}  // namespace

struct LcmBus::Impl {
  Impl(const std::string& u, std::int64_t first_wait_ns) : url(u), wait(first_wait_ns, kLongestLcmWait_ns) {}

  // Joins, and listens where something is subscribed. On the polling thread.
  void open() noexcept {
    const std::int64_t now_ns = rt::RealClock().monotonicNs();
    if (!wait.due(now_ns)) return;
    lcm_t* joined = lcm_create(url.c_str());
    if (joined == nullptr) {
      reason = kLcmNotJoined;
    } else if (receiver != nullptr && !listen(joined)) {
      lcm_destroy(joined);
      joined = nullptr;
      reason = kNoLoopback;
    }
    // The try itself may have taken longer than the wait.
    if (joined == nullptr) return wait.failed(rt::RealClock().monotonicNs());
    wait.succeeded();
    reason = nullptr;
    const std::lock_guard<std::mutex> lock(mutex);
    lcm = joined;
  }
  bool listen(lcm_t* joined) noexcept {
    lcm_subscription_t* subscription = lcm_subscribe(joined, channels.c_str(), handOver, receiver);
    if (subscription == nullptr) return false;
    lcm_subscription_set_queue_capacity(subscription, queue);
    fd = lcm_get_fileno(joined);
    return true;
  }
  void close(const char* why) noexcept {
    lcm_t* left = nullptr;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      std::swap(left, lcm);
    }
    if (left != nullptr) lcm_destroy(left);
    fd = -1;
    reason = why;
    wait.failed(rt::RealClock().monotonicNs());
  }

  std::string url, channels;
  int queue = 0;
  Receiver* receiver = nullptr;
  rt::RetryWait wait;
  const char* reason = nullptr;
  int fd = -1;  // nothing to read: nothing is subscribed
  // Of `lcm` as far as the publishing threads use it; only the polling thread changes it.
  std::mutex mutex;
  lcm_t* lcm = nullptr;
  std::atomic<std::uint64_t> refused{0};
};

LcmBus::LcmBus(const std::string& url, std::int64_t first_wait_ns)
    : impl_(std::make_unique<Impl>(url, first_wait_ns)) {
  if (!isLcmUrl(url)) throw InputError("LCM " + url, "", kLcmNotJoined);
  impl_->open();
}

LcmBus::~LcmBus() {
  if (impl_->lcm != nullptr) lcm_destroy(impl_->lcm);
}

bool LcmBus::publish(const LogMessage& message) noexcept {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    if (impl_->lcm != nullptr && lcm_publish(impl_->lcm, message.channel.c_str(), message.data.data(),
                                             static_cast<unsigned>(message.data.size())) == 0)
      return true;
  }
  ++impl_->refused;
  return false;
}

std::uint64_t LcmBus::refused() const noexcept {
  return impl_->refused;
}

void LcmBus::subscribe(const std::string& channels, int queue, Receiver& receiver) {
  impl_->channels = channels;
  impl_->queue = queue;
  impl_->receiver = &receiver;
  if (impl_->lcm != nullptr && !impl_->listen(impl_->lcm)) impl_->close(kNoLoopback);
}

int LcmBus::poll(int timeout_ms, int max_messages) noexcept {
  if (impl_->lcm == nullptr) impl_->open();
  if (impl_->lcm == nullptr) {
    ::poll(nullptr, 0, timeout_ms);
    return -1;
  }
  pollfd bus = {impl_->fd, POLLIN, 0};
  int handled = 0;
  // liblcm's descriptor is readable while messages wait.
  while (handled < max_messages && ::poll(&bus, 1, handled == 0 ? timeout_ms : 0) == 1) {
    if ((bus.revents & POLLIN) == 0 || lcm_handle(impl_->lcm) != 0) {
      impl_->close("has failed");
      return -1;
    }
    ++handled;
  }
  return handled;
}

bool LcmBus::isOpen() const noexcept {
  return impl_->lcm != nullptr;
}

const char* LcmBus::reason() const noexcept {
  return impl_->reason == nullptr ? "" : impl_->reason;
}

void visitLcm(KeyVisitor& keys, LcmConfig& c) {
  keys.text("url", c.url, "LCM provider; empty: no LCM");
  std::string accept, known;
  const auto add = [](std::string& words, std::string_view word) {
    words += (words.empty() ? "" : " ") + std::string(word);
  };
  for (std::size_t i = 0; i < kSampleWords.size(); ++i) {
    add(known, kSampleWords[i]);
    if (c.accept[i]) add(accept, kSampleWords[i]);
  }
  keys.text("accept", accept, ("words from " + known + ": taken from the bus").c_str());
  c.accept.fill(false);
  std::istringstream words(accept);
  for (std::string word; words >> word;) {
    const auto found = std::find(kSampleWords.begin(), kSampleWords.end(), word);
    keys.require(found != kSampleWords.end(), "accept", "'" + word + "' is none of " + known);
    c.accept[static_cast<std::size_t>(found - kSampleWords.begin())] = true;
  }
  keys.number("max_age_s", c.max_age_s, "s", 0.1, 3600,
              "a stamp further from its arrival is refused (a USBL fix: 300 s back)");
  keys.integer("queue", c.queue, "messages", 1, 100'000, "that wait, and are handled a poll");
  keys.number(
      "publish_hz", c.publish_hz, "Hz", 0, 100,
      "of the pose; 0: no poses are sent, on the bus or to the log. Health, map and link once a second");
}

LcmSource::LcmSource(const LcmConfig& config, std::shared_ptr<LcmBus> bus, const std::string& vehicle_name,
                     VehicleTime now, VehicleClockState clock)
    : config_(config), bus_(std::move(bus)), now_(std::move(now)), clock_(std::move(clock)) {
  std::string channels;
  const auto listen = [&](const std::string& channel) {
    channels += (channels.empty() ? "" : "|") + channel;
  };
  for (std::size_t kind = 0; kind < kDeviceKinds; ++kind)
    if (config_.accept[kind]) listen(kSampleChannels[kind]);
  if (config_.accept[SensorSample(AttitudeSample{}).index()]) listen("TCM");
  if (config_.accept[SensorSample(DepthSample{}).index()]) listen("PAROSCI");
  // A vehicle's name has letters, digits, - and _ alone (mission.toml).
  if (config_.accept[SensorSample(UsblFix{}).index()]) listen("USBL_FIX\\." + vehicle_name);
  if (!channels.empty()) bus_->subscribe("(" + channels + ")", config_.queue, *this);
  works_ = bus_->isOpen();
}

bool LcmSource::poll(int timeout_ms, SampleSink& sink) {
  sink_ = &sink;
  const int handled = bus_->poll(timeout_ms, config_.queue);
  sink_ = nullptr;
  // A bus that has failed goes away once, however long it is waited for.
  if (handled < 0 && works_) ++failures_;
  works_ = handled >= 0;
  return works_;
}

void LcmSource::message(std::string_view channel, std::span<const std::uint8_t> data) noexcept {
  if (sink_ == nullptr) return;
  const std::int64_t arrival_ns = now_();
  const bool native = channelKind(channel) == ChannelKind::kSample;
  std::optional<SensorSample> sample;
  try {
    const auto decoded = native ? decodeSample(channel, data) : decodeAcfr(channel, arrival_ns / 1000, data);
    if (decoded) sample = decoded->sample;
  } catch (const std::exception&) {
    // Without memory for it, a message is counted as damaged.
  }
  if (!sample || !std::visit(Plausible{}, *sample)) {
    ++bad_;
    return;
  }
  const std::size_t kind = sample->index();
  if (!config_.accept[kind]) {
    ++unasked_;
    return;
  }
  if (!native && last_native_ns_[kind] != 0 && arrival_ns - last_native_ns_[kind] < kTwinsFor_ns) {
    ++twins_;
    return;
  }
  if (!toVehicleTime(*sample, arrival_ns)) {
    ++stale_;
    return;
  }
  // A fix is known from its arrival on.
  if (auto* fix = std::get_if<UsblFix>(&*sample)) fix->arrival_utc_ns = arrival_ns;
  if (native) last_native_ns_[kind] = arrival_ns;
  ++taken_[kind];
  ++samples_;
  last_sample_ns_ = arrival_ns;
  sink_->sample(arrival_ns, *sample);
}

// False for a stamp too far from its arrival.
bool LcmSource::toVehicleTime(SensorSample& sample, std::int64_t arrival_ns) const noexcept {
  const rt::ClockState state = clock_ ? clock_() : rt::ClockState{};
  std::int64_t& stamp_ns = std::visit([](auto& s) -> std::int64_t& { return s.utc_ns; }, sample);
  const double oldest = std::holds_alternative<UsblFix>(sample) ? kMaxFixAge_s : config_.max_age_s;
  const auto fits = [&](std::int64_t vehicle_ns) {
    const double age_s = static_cast<double>(arrival_ns - vehicle_ns) / 1e9;
    return age_s <= oldest && age_s >= -config_.max_age_s;
  };
  if (fits(stamp_ns + state.error_ns)) {
    stamp_ns += state.error_ns;
    return true;
  }
  return !state.synchronised && fits(stamp_ns);
}

DeviceHealth LcmSource::health() const {
  DeviceHealth health;
  health.name = "lcm";
  health.open = bus_->isOpen();
  health.reason = bus_->reason();
  health.last_data_ns = last_sample_ns_;
  health.samples = samples_;
  health.disconnects = failures_;
  health.counters = {{"bad", bad_},         {"stale", stale_},       {"twins_left_out", twins_},
                     {"unasked", unasked_}, {"failures", failures_}, {"not_published", bus_->refused()}};
  for (std::size_t kind = 0; kind < kDeviceKinds; ++kind)
    health.counters.add({kSampleWords[kind], taken_[kind]});
  return health;
}

void LcmPublisher::publish(const PoseReport& pose) noexcept {
  try {
    publish(encodePose(pose));
    publish(encodeAcfrNav(pose, vehicle_name_));
  } catch (const std::exception&) {
    // Without memory for it this pose is not published.
  }
}

void LcmPublisher::publish(const LogMessage& message) noexcept {
  if (bus_->publish(message)) ++published_;
}

}  // namespace fathom::io

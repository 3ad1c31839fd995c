#include "firmware_if/devices/can/bus/can_source.hpp"

#include <array>
#include <type_traits>

namespace fathom::io {
namespace {

// Parameter groups that give samples, and those of the address claim.
constexpr std::array<std::uint32_t, 12> kSamplePgns = {127250, 127251, 127257, 127506, 127508, 128267,
                                                       129025, 129029, 130312, 130314, 130316, 130321};
constexpr std::array<std::uint32_t, 2> kAddressPgns = {kRequestPgn, kAddressClaimPgn};
// A flood must not hold the polling thread: what is left waits for the next poll.
constexpr int kMaxCanBatches = 16;

std::vector<std::uint32_t> receivedPgns(bool send) {
  std::vector<std::uint32_t> out(kSamplePgns.begin(), kSamplePgns.end());
  if (send) out.insert(out.end(), kAddressPgns.begin(), kAddressPgns.end());
  return out;
}

constexpr std::int64_t kLastCanAddress = 251;  // 252 to 255 are reserved

// -1 stands for absent.
std::optional<std::uint8_t> smallInteger(const ConfigTable& table, const char* key,
                                         std::optional<std::uint8_t> fallback, std::int64_t max) {
  const std::int64_t value = table.integer(key, fallback ? *fallback : -1, -1, max);
  return value < 0 ? std::nullopt : std::optional(static_cast<std::uint8_t>(value));
}

// 0 stands for absent.
std::optional<double> numberAboveZero(const ConfigTable& table, const char* key,
                                      std::optional<double> fallback, double max) {
  const double value = table.number(key, fallback.value_or(0), 0, max);
  return value > 0 ? std::optional(value) : std::nullopt;
}

void readSources(const ConfigTable& table, N2kSamples::Config& samples) {
  const auto address = [&](const char* key, std::optional<std::uint8_t>& value) {
    value = smallInteger(table, key, value, kLastCanAddress);
  };
  address("heading_address", samples.heading_source);
  address("attitude_address", samples.attitude_source);
  address("gyro_address", samples.gyro_source);
  address("depth_address", samples.depth_source);
  address("battery_address", samples.battery_source);
  address("gps_address", samples.gps_source);
  address("water_address", samples.water_source);
  samples.switch_after_s = table.number("switch_after_s", samples.switch_after_s, 0.1, 1e6);
}

void readSender(const ConfigTable& table, CanConfig& can) {
  CanSender::Config& sender = can.sender;
  can.send = table.boolean("enabled", can.send);
  const auto integer = [&](const char* key, auto& value, std::int64_t min, std::int64_t max) {
    value = static_cast<std::remove_reference_t<decltype(value)>>(table.integer(key, value, min, max));
  };
  integer("address", sender.address, 0, kLastCanAddress);
  integer("unique_number", sender.name.unique_number, 0, 0x1FFFFF);
  integer("manufacturer_code", sender.name.manufacturer_code, 0, 2046);
  integer("device_instance", sender.name.device_instance, 0, 255);
  integer("status_pgn", sender.status_pgn, CanSender::kFirstStatusPgn, CanSender::kLastStatusPgn);
  const auto period = [&](const char* key, double& value) {
    value = table.number(key, value, 0, 3600);
    if (value != 0 && value < 0.1) table.fail(key, "must be 0 (never) or 0.1 to 3600 s");
  };
  period("position_period_s", sender.position_period_s);
  period("fix_period_s", sender.fix_period_s);
  period("depth_period_s", sender.depth_period_s);
  period("status_period_s", sender.status_period_s);
  sender.frames_per_s = table.number("frames_per_s", sender.frames_per_s, 1, 1000);
}

}  // namespace

CanConfig readCanConfig(const ConfigTable& table, CanConfig defaults) {
  CanConfig out = std::move(defaults);
  out.interface = table.text("interface", out.interface);
  N2kSamples::Config& samples = out.samples;
  readSources(table, samples);
  samples.attitude_gap_s = table.number("attitude_gap_s", samples.attitude_gap_s, 0.01, 2);
  samples.message_variation = table.choice("variation", samples.message_variation ? "message" : "mission",
                                           {"mission", "message"}) == "message";
  constexpr std::array kDepthSources = {"pressure", "depth", "offset"};
  const std::string depth =
      table.choice("depth_source", kDepthSources[static_cast<std::size_t>(samples.depth_from)],
                   {"pressure", "depth", "offset"});
  for (std::size_t i = 0; i < kDepthSources.size(); ++i) {
    if (depth == kDepthSources[i]) samples.depth_from = static_cast<N2kSamples::DepthFrom>(i);
  }
  samples.surface_pressure_pa = table.number("surface_pressure_pa", samples.surface_pressure_pa, 0, 120000);
  samples.water_density = numberAboveZero(table, "water_density_kgpm3", samples.water_density, 1200);
  if (samples.water_density && *samples.water_density < 900)
    table.fail("water_density_kgpm3", "must be 0 (standard sea water) or 900 to 1200");
  samples.battery_instance = smallInteger(table, "battery_instance", samples.battery_instance, 252);
  samples.gps_range_sigma_m = table.number("gps_range_sigma_m", samples.gps_range_sigma_m, 0.01, 100);
  samples.salinity_psu = numberAboveZero(table, "salinity_psu", samples.salinity_psu, 50);
  readSender(table.table("send"), out);
  return out;
}

CanSource::CanSource(const CanConfig& config, const rt::Clock& vehicle)
    : vehicle_(vehicle),
      socket_(config.interface, receivedPgns(config.send), vehicle),
      samples_(config.samples) {
  if (config.send) sender_.emplace(config.sender);
}

void CanSource::publish(const VehicleReport& report) noexcept {
  reports_.write(report);
}

void CanSource::sendWhatIsDue() noexcept {
  if (!sender_ || !socket_.isOpen()) return;
  if (started_at_disconnects_ != socket_.counts().disconnects) {
    sender_->start();
    started_at_disconnects_ = socket_.counts().disconnects;
  }
  if (VehicleReport report; reports_.readNew(report)) sender_->publish(report);
  const std::int64_t now_ns = vehicle_.utcNs();
  while (const CanFrame* frame = sender_->next(now_ns)) {
    if (!socket_.send(*frame)) return;
    sender_->sent(now_ns);
  }
}

void CanSource::flushRaw(SampleSink& sink) noexcept {
  const auto bytes = raw_.bytes();
  if (!bytes.empty()) sink.raw(raw_.arrivalNs(), "RAW_CAN", bytes);
  raw_.clear();
}

void CanSource::take(const BusFrame& frame, SampleSink& sink) noexcept {
  if (!raw_.add(frame.frame, frame.error)) {
    flushRaw(sink);
    static_cast<void>(raw_.add(frame.frame, frame.error));
  }
  if (frame.error) return;
  if (sender_) sender_->receive(frame.frame, *frame.frame.utc_ns);
  const N2kMessage* message = decoder_.add(frame.frame);
  if (message == nullptr) return;
  const std::int64_t arrival_ns = *frame.frame.utc_ns;
  for (const SensorSample& sample : samples_.add(*message)) {
    sink.sample(arrival_ns, sample);
    last_data_ns_ = arrival_ns;
  }
}

bool CanSource::poll(int timeout_ms, SampleSink& sink) {
  sendWhatIsDue();
  for (int batch = 0; batch < kMaxCanBatches; ++batch) {
    const auto frames = socket_.receive(batch == 0 ? timeout_ms : 0);
    for (const BusFrame& frame : frames) take(frame, sink);
    if (frames.size() < SocketCan::kBatch) break;
  }
  flushRaw(sink);
  sendWhatIsDue();
  return socket_.isOpen();
}

DeviceHealth CanSource::health() const {
  DeviceHealth out;
  out.name = "can";
  for (const char* name :
       {"frames", "messages", "kernel_drops", "ill_formed", "other_sources", "source_changes",
        "incomplete_messages", "unpaired_headings", "incomplete_fast_packets", "clock_steps", "sent",
        "send_drops", "requests_answered", "address", "addresses_lost", "bus_is_off", "error_frames"})
    out.counters.emplace_back(name, 0);
  for (std::uint8_t kind = 0; kind < CanErrors::kKinds; ++kind)
    out.counters.emplace_back(CanErrors::name(static_cast<CanErrors::Kind>(kind)), 0);
  updateHealth(out);
  return out;
}

void CanSource::updateHealth(DeviceHealth& health) const noexcept {
  const SocketCan::Counts& socket = socket_.counts();
  const N2kSamples::Counts samples = samples_.counts();
  health.open = socket_.isOpen();
  health.last_data_ns = last_data_ns_;
  health.samples = samples.samples;
  health.disconnects = socket.disconnects;
  // In the order of health().
  const CanSender::Counts sending = sender_ ? sender_->counts() : CanSender::Counts{};
  const std::array<std::uint64_t, 17> values = {
      socket.frames,
      decoder_.counts().messages,
      socket.kernel_drops,
      socket.ill_formed,
      samples.other_sources,
      samples.source_changes,
      samples.incomplete,
      samples.unpaired_headings,
      decoder_.fastPacketCounts().incomplete,
      socket_.clockSteps(),
      socket.sent,
      sending.dropped,
      sending.requests,
      sender_ ? sender_->claim().address() : std::uint64_t{kNoAddress},
      sender_ ? sender_->claim().lost() : 0,
      socket_.errors().busOff() ? 1U : 0U,
      socket_.errors().frames()};
  if (health.counters.size() != values.size() + CanErrors::kKinds) return;
  for (std::size_t i = 0; i < values.size(); ++i) health.counters[i].second = values[i];
  for (std::uint8_t kind = 0; kind < CanErrors::kKinds; ++kind)
    health.counters[values.size() + kind].second = socket_.errors().count(static_cast<CanErrors::Kind>(kind));
}

}  // namespace fathom::io

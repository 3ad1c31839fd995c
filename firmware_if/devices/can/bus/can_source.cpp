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

void visitSender(KeyVisitor& keys, CanConfig& can) {
  CanSender::Config& sender = can.sender;
  keys.boolean("enabled", can.send, "whether anything is sent");
  keys.integer("address", sender.address, 0, kLastCanAddress, "preferred");
  keys.integer("unique_number", sender.name.unique_number, 0, 0x1FFFFF, "of the NAME");
  keys.integer("manufacturer_code", sender.name.manufacturer_code, 0, 2046, "of the NAME");
  keys.integer("device_instance", sender.name.device_instance, 0, 255, "of the NAME");
  keys.integer("status_pgn", sender.status_pgn, CanSender::kFirstStatusPgn, CanSender::kLastStatusPgn,
               "of the status");
  const auto period = [&](const char* key, double& value, const char* meaning) {
    keys.number(key, value, "s", 0, 3600, meaning);
    keys.require(value == 0 || value >= 0.1, key, "must be 0 (never) or 0.1 to 3600 s");
  };
  period("position_period_s", sender.position_period_s, "0 (never) or 0.1 at least");
  period("fix_period_s", sender.fix_period_s, "the same");
  period("depth_period_s", sender.depth_period_s, "the same");
  period("status_period_s", sender.status_period_s, "the same");
  keys.number("frames_per_s", sender.frames_per_s, "1/s", 1, 1000, "at most");
}

}  // namespace

void visitCan(KeyVisitor& keys, CanConfig& can) {
  constexpr const char* kVariations[] = {"mission", "message"};
  constexpr const char* kDepthSources[] = {"pressure", "depth", "offset"};
  N2kSamples::Config& c = can.samples;
  keys.text("interface", can.interface, "as `ip link` names it; empty: no CAN");
  keys.optionalInteger("heading_address", c.heading_source, kLastCanAddress,
                       "that headings are taken from; -1: the first to send");
  keys.optionalInteger("attitude_address", c.attitude_source, kLastCanAddress, "roll and pitch");
  keys.optionalInteger("gyro_address", c.gyro_source, kLastCanAddress, "rate of turn");
  keys.optionalInteger("depth_address", c.depth_source, kLastCanAddress, "depth");
  keys.optionalInteger("battery_address", c.battery_source, kLastCanAddress, "battery");
  keys.optionalInteger("gps_address", c.gps_source, kLastCanAddress, "GPS");
  keys.optionalInteger("water_address", c.water_source, kLastCanAddress, "water");
  keys.number("switch_after_s", c.switch_after_s, "s", 0.1, 1e6,
              "silence after which a source that is not configured is replaced");
  keys.number("attitude_gap_s", c.attitude_gap_s, "s", 0.01, 2,
              "between the roll and pitch around a heading");
  keys.choiceOf(
      "variation", c.message_variation, kVariations,
      "mission: headings stay magnetic, mission.toml's declination counts; message: that of 127250, "
      "where sent");
  keys.choiceOf("depth_source", c.depth_from, kDepthSources, "130314 of source water, or fields of 128267");
  keys.number("surface_pressure_pa", c.surface_pressure_pa, "Pa", 0, 120000,
              "what the sensor shows in air; 0 for a gauge");
  keys.optionalNumber("water_density_kgpm3", c.water_density, "kg/m3", 1200,
                      "900 at least; 0: the ocean of UNESCO 44");
  keys.require(!c.water_density || *c.water_density >= 900, "water_density_kgpm3",
               "must be 0 (standard sea water) or 900 to 1200");
  keys.optionalInteger("battery_instance", c.battery_instance, 252, "-1: the first received");
  keys.number("gps_range_sigma_m", c.gps_range_sigma_m, "m", 0.01, 100, "sigma of a fix = HDOP times this");
  keys.optionalNumber("salinity_psu", c.salinity_psu, "psu", 50,
                      "where no 130321 comes; 0: unknown, then no sound speed");
  keys.table("send", "what the vehicle says on the bus", [&] { visitSender(keys, can); });
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
  const SocketCan::Counts& socket = socket_.counts();
  const N2kSamples::Counts samples = samples_.counts();
  const CanSender::Counts sending = sender_ ? sender_->counts() : CanSender::Counts{};
  DeviceHealth health;
  health.name = "can";
  health.open = socket_.isOpen();
  health.last_data_ns = last_data_ns_;
  health.samples = samples.samples;
  health.disconnects = socket.disconnects;
  health.counters = {{"frames", socket.frames},
                     {"messages", decoder_.counts().messages},
                     {"kernel_drops", socket.kernel_drops},
                     {"ill_formed", socket.ill_formed},
                     {"other_sources", samples.other_sources},
                     {"source_changes", samples.source_changes},
                     {"incomplete_messages", samples.incomplete},
                     {"unpaired_headings", samples.unpaired_headings},
                     {"incomplete_fast_packets", decoder_.fastPacketCounts().incomplete},
                     {"clock_steps", socket_.clockSteps()},
                     {"sent", socket.sent},
                     {"send_drops", sending.dropped},
                     {"requests_answered", sending.requests},
                     {"address", sender_ ? sender_->claim().address() : std::uint64_t{kNoAddress}},
                     {"addresses_lost", sender_ ? sender_->claim().lost() : 0},
                     {"bus_is_off", socket_.errors().busOff() ? 1U : 0U},
                     {"error_frames", socket_.errors().frames()}};
  for (std::uint8_t kind = 0; kind < CanErrors::kKinds; ++kind)
    health.counters.add({CanErrors::name(static_cast<CanErrors::Kind>(kind)),
                         socket_.errors().count(static_cast<CanErrors::Kind>(kind))});
  return health;
}

}  // namespace fathom::io

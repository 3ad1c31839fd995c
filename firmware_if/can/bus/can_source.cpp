#include "firmware_if/can/bus/can_source.hpp"

#include <array>

namespace fathom::io {
namespace {

// What the samples are made of, and what keeps an address on the bus.
constexpr std::array<std::uint32_t, 12> kSamplePgns = {127250, 127251, 127257, 127506, 127508, 128267,
                                                       129025, 129029, 130312, 130314, 130316, 130321};
constexpr std::array<std::uint32_t, 2> kAddressPgns = {kRequestPgn, kAddressClaimPgn};
// A flood must not hold the polling thread: what is left waits for the next poll.
constexpr int kMaxBatches = 16;

std::vector<std::uint32_t> pgns(bool send) {
  std::vector<std::uint32_t> out(kSamplePgns.begin(), kSamplePgns.end());
  if (send) out.insert(out.end(), kAddressPgns.begin(), kAddressPgns.end());
  return out;
}

}  // namespace

CanSource::CanSource(const CanConfig& config, const rt::Clock& vehicle)
    : vehicle_(vehicle), socket_(config.interface, pgns(config.send), vehicle), samples_(config.samples) {
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
  for (int batch = 0; batch < kMaxBatches; ++batch) {
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

#include "realtime/onboard/modem/frame_exchange.hpp"

#include <thread>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/wire/bundle.hpp"

namespace fathom::onboard {
namespace {

// Frames received at one time: bounded, so that a flooded modem cannot stop the vehicle.
constexpr int kMostReceived = 64;
// A dive of a day at ten frames a second; more is no recording of a downlink.
constexpr std::size_t kMostRecorded = 864000;

std::vector<telemetry::Packet> readRecording(const std::filesystem::path& path) {
  telemetry::PacketLogReader reader(path);
  std::vector<telemetry::Packet> packets;
  while (auto packet = reader.next()) {
    const std::string place = "frame " + std::to_string(packets.size());
    if (packets.size() == kMostRecorded)
      throw InputError(path.string(), place, "more frames than a dive receives; give a downlink.bin");
    if (!packets.empty() && packet->utc_ns < packets.back().utc_ns)
      throw InputError(path.string(), place,
                       "is older than the one before it; give an unchanged downlink.bin");
    packets.push_back(std::move(*packet));
  }
  return packets;
}

}  // namespace

FrameExchange::FrameExchange(OnboardOutput& output, const FrameExchangeOptions& options)
    : output_(output), options_(options) {
  if (options_.downlink) recorded_ = readRecording(*options_.downlink);
}

void FrameExchange::pace(std::int64_t now_ns) const {
  if (options_.modem == nullptr || options_.speed <= 0) return;
  const double due = static_cast<double>(now_ns - first_ns_) / kNanosecondsPerSecond / options_.speed;
  std::this_thread::sleep_until(
      start_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(due)));
}

void FrameExchange::receive(OnboardSystem& system, std::int64_t now_ns, std::span<const std::uint8_t> frame) {
  output_.addDownlink(now_ns, frame);
  ++counters_.received;
  system.receiveFrame(now_ns, frame);
}

void FrameExchange::receiveAll(OnboardSystem& system, std::int64_t now_ns) {
  if (options_.downlink) {
    for (; next_recorded_ < recorded_.size() && recorded_[next_recorded_].utc_ns <= now_ns; ++next_recorded_)
      receive(system, now_ns, recorded_[next_recorded_].bytes);
    return;
  }
  if (options_.modem == nullptr) return;
  for (int i = 0; i < kMostReceived; ++i) {
    const std::size_t size = options_.modem->receive(buffer_);
    if (size == 0) return;
    telemetry::LinkFrames frames(std::span<const std::uint8_t>(buffer_).first(size));
    while (const auto frame = frames.next()) receive(system, now_ns, *frame);
  }
}

void FrameExchange::exchange(OnboardSystem& system, std::int64_t now_ns, bool survey_over) {
  if (!received_at_ns_) {
    first_ns_ = now_ns;
    start_ = Clock::now();
  }
  if (!received_at_ns_ || now_ns > *received_at_ns_) {
    received_at_ns_ = now_ns;
    pace(now_ns);
    if (options_.modem_clock) options_.modem_clock(now_ns);
    receiveAll(system, now_ns);
  }
  while (const std::size_t size = system.nextFrame(now_ns, survey_over, buffer_)) {
    const std::span<const std::uint8_t> frame(buffer_.data(), size);
    output_.addPacket(now_ns, frame);
    ++counters_.sent;
    counters_.sent_bytes += size;
    if (options_.modem != nullptr && !options_.modem->send(frame)) ++counters_.refused;
  }
}

}  // namespace fathom::onboard

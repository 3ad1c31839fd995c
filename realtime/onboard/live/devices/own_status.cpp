#include "realtime/onboard/live/devices/own_status.hpp"

#include <array>

#include "telemetry/wire/bundle.hpp"

namespace fathom::onboard {

void OwnStatus::set(const telemetry::Status& status, bool mapper) noexcept {
  known_.write({status, mapper ? 1U : 0U});
}

bool OwnStatus::nextVersion(telemetry::Version& version) const noexcept {
  version = next_.load(std::memory_order_relaxed);
  return any_.load(std::memory_order_acquire);
}

bool OwnStatus::next(std::int64_t now_ns, OutgoingFrame& frame) noexcept {
  Known known;
  if (last_ns_ == 0) last_ns_ = now_ns;
  if (!known_.read(known) || known.mapper != 0) return false;
  if (now_ns - last_ns_ < (own_turn_ ? config_.period_ns : config_.silent_ns)) return false;
  std::array<std::uint8_t, telemetry::kStatusBytes> payload{};
  const std::size_t bytes = telemetry::encodeStatus(known.status, payload);
  telemetry::FrameHeader header;
  header.identity = config_.identity;
  header.type = telemetry::MessageType::kStatus;
  // The ship may answer: after a status alone nothing else waits to be said.
  header.turn = true;
  const auto passed_over = own_turn_ ? std::uint16_t{0} : config_.passed_over;
  header.version = next_.load(std::memory_order_relaxed) + passed_over;
  const bool padded = config_.padded_bytes > 0;
  const std::span<std::uint8_t> out(frame.bytes);
  telemetry::ModemFrameWriter modem(padded ? out.first(config_.padded_bytes) : out, padded);
  modem.add(telemetry::encodeFrame(header, std::span(payload).first(bytes), modem.room(), config_.tag));
  frame.size = static_cast<std::uint16_t>(modem.finish());
  return true;
}

bool OwnStatus::sent(std::int64_t now_ns, std::span<const std::uint8_t> bytes, bool own) noexcept {
  last_ns_ = now_ns;
  own_turn_ = own;
  bool turn = false;
  telemetry::LinkFrames link_frames(bytes);
  while (const auto link_frame = link_frames.next()) {
    const telemetry::DecodedFrame frame = telemetry::peekFrame(*link_frame);
    if (frame.verdict != telemetry::FrameVerdict::kAccepted) continue;
    turn = turn || frame.header.turn;
    // A repair frame names another's number.
    if (frame.header.type == telemetry::MessageType::kRepair) continue;
    const telemetry::Version before = next_.load(std::memory_order_relaxed);
    next_.store(telemetry::versionNear(frame.header.sequence(), before) + 1, std::memory_order_relaxed);
    any_.store(true, std::memory_order_release);
  }
  return turn;
}

}  // namespace fathom::onboard

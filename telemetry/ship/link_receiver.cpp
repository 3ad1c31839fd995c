#include "telemetry/ship/link_receiver.hpp"

#include <algorithm>

#include "realtime/kernel/crc32.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kLeastReach = 16;  // frames before the oldest turn spoken of
constexpr Version kLap = 0x10000;        // of sequence numbers

}  // namespace

// Numbers that come again count as later ones, and there is room below the first for frames that come late.
Version LinkReceiver::beginAnew(std::uint16_t sequence) {
  if (started_) ++counters_.resyncs;
  newest_ = (started_ ? (newest_ / kLap + 2) * kLap : kLap) + sequence;
  started_ = true;
  stale_run_ = 0;
  turn_count_ = 0;
  slots_.fill({});
  repair_.clear();
  held_.clear();
  return newest_;
}

std::optional<Version> LinkReceiver::admit(std::uint16_t sequence, std::uint32_t crc) {
  if (!started_) (void)beginAnew(sequence);
  Version version = versionNear(sequence, newest_);
  const auto ahead = static_cast<std::int32_t>(version - newest_);
  if (ahead > 0) {
    for (int i = std::max(1, ahead - kWindow); i < ahead; ++i)
      slot(newest_ + static_cast<Version>(i)) = {State::kMissing, 0};
    counters_.lost += static_cast<std::uint64_t>(ahead - 1);
    newest_ = version;
  } else if (ahead <= -kWindow) {
    const int step = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - last_stale_));
    stale_run_ = stale_run_ > 0 && step > 0 && step < kWindow ? stale_run_ + 1 : 1;
    last_stale_ = sequence;
    if (stale_run_ < kStaleRun) return std::nullopt;
    version = beginAnew(sequence);
  } else {
    const Slot& known = slot(version);
    const bool held = known.state == State::kRepaired || known.state == State::kSeen;
    if (held && known.crc == crc) return std::nullopt;
    if (held) {
      version = beginAnew(sequence);
    } else if (ahead < 0) {
      if (known.state == State::kMissing) --counters_.lost;
      ++counters_.reordered;
    }
  }
  stale_run_ = 0;
  slot(version) = {State::kSeen, crc};
  held_.hold(version);
  if (damage_) held_.noteDamage(version);
  damage_ = false;
  return version;
}

DecodedFrame LinkReceiver::accept(std::span<const std::uint8_t> bytes, const Deliver& deliver) {
  DecodedFrame frame = decodeFrame(bytes);
  ++counters_.frames;
  counters_.bytes += bytes.size();
  const MessageType type = frame.header.type;
  if (frame.verdict == FrameVerdict::kAccepted && type == MessageType::kDownlink)
    frame.verdict = FrameVerdict::kType;  // an echo of the ship's own voice
  if (frame.verdict == FrameVerdict::kAccepted) {
    if (!identity_) identity_ = frame.header.identity;
    if (frame.header.identity != *identity_) frame.verdict = FrameVerdict::kForeign;
  }
  if (frame.verdict == FrameVerdict::kAccepted) {
    if (type == MessageType::kRepair) {
      const RepairDecoder::Taken taken = repair_.repair(frame.header.sequence, frame.payload);
      if (taken == RepairDecoder::Taken::kInvalid) frame.verdict = FrameVerdict::kBadPayload;
      if (taken == RepairDecoder::Taken::kDuplicate) frame.verdict = FrameVerdict::kDuplicate;
    } else if (const auto version = admit(frame.header.sequence, crc32(frame.payload))) {
      repair_.source(frame.header.sequence, frame.payload, type == MessageType::kMapPacket);
      if (!deliver({type, *version, frame.payload})) frame.verdict = FrameVerdict::kBadPayload;
    } else {
      frame.verdict = FrameVerdict::kDuplicate;
    }
  }
  ++counters_.verdicts[static_cast<std::size_t>(frame.verdict)];
  if (frame.verdict != FrameVerdict::kAccepted && frame.verdict != FrameVerdict::kBadPayload) return frame;
  if (frame.verdict == FrameVerdict::kAccepted) ++counters_.types[static_cast<std::size_t>(type)];
  turn_ = frame.header.turn;
  if (turn_) turns_[turn_count_++ % kTurnsBack] = newest_;
  repair(deliver);
  return frame;
}

void LinkReceiver::repair(const Deliver& deliver) {
  repair_.solve([&](std::uint16_t sequence, std::span<const std::uint8_t> payload) {
    if (!started_) return;
    // Repair frames may overtake what they repair: a group's last frames, lost, are not missed yet.
    const Version version = versionNear(sequence, newest_);
    const auto ahead = static_cast<std::int32_t>(version - newest_);
    if (ahead <= -kWindow || ahead > kMaxGroup) return;
    if (ahead > 0) {
      for (int i = 1; i <= ahead; ++i) slot(newest_ + static_cast<Version>(i)) = {State::kMissing, 0};
      counters_.lost += static_cast<std::uint64_t>(ahead);
      newest_ = version;
    }
    Slot& known = slot(version);
    if (known.state == State::kSeen || known.state == State::kRepaired) return;
    if (known.state == State::kMissing) --counters_.lost;
    known = {State::kRepaired, crc32(payload)};
    held_.hold(version);
    ++counters_.repaired;
    if (!deliver({MessageType::kMapPacket, version, payload})) ++counters_.repaired_invalid;
  });
}

Acknowledgement LinkReceiver::acknowledgement() const {
  std::size_t furthest = Acknowledgement::kMaxReach;
  if (turn_count_ >= kTurnsBack)
    furthest = std::min(furthest, std::size_t{newest_ - turns_[turn_count_ % kTurnsBack]} + kLeastReach);
  return held_.latest(furthest);
}

}  // namespace fathom::telemetry

#include "telemetry/ship/link_receiver.hpp"

#include <algorithm>

namespace fathom::telemetry {
namespace {

constexpr std::size_t kLeastReach = 16;  // frames before the oldest turn spoken of

std::uint32_t crcOf(std::span<const std::uint8_t> frame) {
  std::uint32_t crc = 0;
  for (const std::uint8_t byte : frame.last(sizeof crc)) crc = crc << 8 | byte;
  return crc;
}

}  // namespace

void LinkReceiver::beginAnew(std::uint16_t sequence) {
  if (started_) ++counters_.resyncs;
  started_ = true;
  newest_ = sequence;
  stale_run_ = 0;
  turn_count_ = 0;
  slots_.fill({});
  repair_.clear();
}

bool LinkReceiver::admitSequence(std::uint16_t sequence, std::uint32_t crc) {
  const int ahead = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - newest_));
  if (!started_ || ahead > kResyncJump || ahead < -kResyncJump) {
    beginAnew(sequence);
  } else if (ahead > 0) {
    for (int i = std::max(1, ahead - kWindow); i < ahead; ++i) slot(newest_ + i) = {State::kMissing, 0};
    counters_.lost += static_cast<std::uint64_t>(ahead - 1);
    newest_ = sequence;
  } else if (ahead <= -kWindow) {
    const int step = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - last_stale_));
    stale_run_ = stale_run_ > 0 && step > 0 && step < kWindow ? stale_run_ + 1 : 1;
    last_stale_ = sequence;
    if (stale_run_ < kStaleRun) return false;
    beginAnew(sequence);
  } else {
    const Slot& known = slot(sequence);
    if (known.state == State::kRepaired || (known.state == State::kSeen && known.crc == crc)) return false;
    if (known.state == State::kSeen) {
      beginAnew(sequence);
    } else {
      if (known.state == State::kMissing) --counters_.lost;
      ++counters_.reordered;
    }
  }
  stale_run_ = 0;
  slot(sequence) = {State::kSeen, crc};
  return true;
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
    } else if (!admitSequence(frame.header.sequence, crcOf(bytes))) {
      frame.verdict = FrameVerdict::kDuplicate;
    } else {
      repair_.source(frame.header.sequence, frame.payload, type == MessageType::kMapPacket);
      if (!deliver(type, frame.payload)) frame.verdict = FrameVerdict::kBadPayload;
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
    // Repair frames may overtake what they repair: a group's last frames, lost, are not missed yet.
    const int ahead = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - newest_));
    if (!started_ || ahead <= -kWindow || ahead > kMaxGroup) return;
    if (ahead > 0) {
      for (int i = 1; i <= ahead; ++i) slot(newest_ + i) = {State::kMissing, 0};
      counters_.lost += static_cast<std::uint64_t>(ahead);
      newest_ = sequence;
    }
    Slot& known = slot(sequence);
    if (known.state == State::kSeen || known.state == State::kRepaired) return;
    if (known.state == State::kMissing) --counters_.lost;
    known.state = State::kRepaired;
    ++counters_.repaired;
    if (!deliver(MessageType::kMapPacket, payload)) ++counters_.repaired_invalid;
  });
}

Acknowledgement LinkReceiver::acknowledgement() const {
  Acknowledgement a;
  a.valid = started_;
  a.newest = newest_;
  std::size_t furthest = Acknowledgement::kMaxReach;
  if (turn_count_ >= kTurnsBack) {
    const auto since = static_cast<std::uint16_t>(newest_ - turns_[turn_count_ % kTurnsBack]);
    furthest = std::min(furthest, std::size_t{since} + kLeastReach);
  }
  for (; started_ && a.reach < furthest; ++a.reach) {
    const std::size_t at = static_cast<std::uint16_t>(newest_ - 1 - a.reach);
    const State state = slots_[at % static_cast<std::size_t>(kWindow)].state;
    if (state == State::kBeforeStart) break;
    a.before[a.reach] = state != State::kMissing;
  }
  return a;
}

}  // namespace fathom::telemetry

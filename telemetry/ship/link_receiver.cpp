#include "telemetry/ship/link_receiver.hpp"

#include <algorithm>

#include "realtime/base/bytes/crc32.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kLeastReach = 16;  // frames before the oldest turn that are acknowledged
constexpr Version kLap = 0x10000;        // of sequence numbers

}  // namespace

Version LinkReceiver::restart(Version version) {
  if (started_) ++counters_.resyncs;
  newest_ = version;
  began_ = version / kLap * kLap;
  started_ = true;
  stale_run_ = 0;
  turn_count_ = 0;
  slots_.fill({});
  repair_.clear();
  ship_frames_.clear();
  return newest_;
}

// Restarts at later versions for sequence numbers that come again.
Version LinkReceiver::restartAfterNewest(std::uint16_t sequence) {
  return restart((started_ ? (newest_ / kLap + 2) * kLap : kLap) + sequence);
}

// Admits a frame from before the window: late, or of a restarted sender.
std::optional<Version> LinkReceiver::farBack(const DecodedFrame& frame, Version version,
                                             std::uint32_t digest) {
  const std::uint16_t sequence = frame.header.sequence();
  if (!frame.whole_version) {
    const int step = static_cast<std::int16_t>(static_cast<std::uint16_t>(sequence - last_stale_));
    stale_run_ = stale_run_ > 0 && step > 0 && step < kWindow ? stale_run_ + 1 : 1;
    last_stale_ = sequence;
    if (stale_run_ < kStaleRun) return std::nullopt;
    return restartAfterNewest(sequence);
  }
  if (!ship_frames_.holds(version)) return version;
  return ship_frames_.holdsOther(version, digest) ? std::optional(restartAfterNewest(sequence))
                                                  : std::nullopt;
}

std::optional<Version> LinkReceiver::admit(const DecodedFrame& frame, std::uint32_t digest) {
  const std::uint16_t sequence = frame.header.sequence();
  if (!started_) {
    if (frame.whole_version)
      (void)restart(frame.header.version);
    else
      (void)restartAfterNewest(sequence);
  }
  Version version = frame.whole_version ? frame.header.version + shift_ : versionNear(sequence, newest_);
  const auto ahead = static_cast<std::int32_t>(version - newest_);
  if (ahead > static_cast<std::int32_t>(kLap)) {
    (void)restart(version);
  } else if (ahead > 0) {
    for (int i = std::max(1, ahead - kWindow); i < ahead; ++i)
      slot(newest_ + static_cast<Version>(i)) = State::kMissing;
    counters_.lost += static_cast<std::uint64_t>(ahead - 1);
    newest_ = version;
  } else if (ahead <= -kWindow) {
    const auto admitted = farBack(frame, version, digest);
    if (!admitted) return std::nullopt;
    if (*admitted == version) {
      ++counters_.reordered;
      if (counters_.lost > 0) --counters_.lost;
    }
    version = *admitted;
  } else {
    if (ship_frames_.holds(version) && !ship_frames_.holdsOther(version, digest)) return std::nullopt;
    if (ship_frames_.holds(version)) {
      version = restartAfterNewest(sequence);
    } else if (ahead < 0) {
      if (slot(version) == State::kMissing) --counters_.lost;
      ++counters_.reordered;
    }
  }
  if (frame.whole_version) shift_ = version - frame.header.version;
  stale_run_ = 0;
  if (newest_ - version < static_cast<Version>(kWindow)) slot(version) = State::kSeen;
  ship_frames_.add(version, digest);
  if (damage_) ship_frames_.noteDamage(version);
  damage_ = false;
  return version;
}

DecodedFrame LinkReceiver::accept(std::span<const std::uint8_t> bytes, const Deliver& deliver,
                                  std::int64_t now_ns) {
  const std::optional<Version> near = started_ ? std::optional(newest_ - shift_) : std::nullopt;
  DecodedFrame frame = laps_.decode(bytes, tag_, near, now_ns);
  ++counters_.frames;
  counters_.bytes += bytes.size();
  const MessageType type = frame.header.type;
  if (frame.verdict == FrameVerdict::kAccepted && type == MessageType::kDownlink)
    frame.verdict = FrameVerdict::kType;
  if (frame.verdict == FrameVerdict::kAccepted) {
    if (!identity_) identity_ = frame.header.identity;
    if (frame.header.identity != *identity_) frame.verdict = FrameVerdict::kForeign;
  }
  if (frame.verdict == FrameVerdict::kAccepted) {
    const bool old = started_ && frame.whole_version && frame.header.version + shift_ < began_;
    if (old) {
      frame.verdict = FrameVerdict::kOld;
    } else if (type == MessageType::kRepair) {
      const RepairDecoder::Taken taken = repair_.repair(frame.header.sequence(), frame.payload, frame.group);
      if (taken == RepairDecoder::Taken::kInvalid) frame.verdict = FrameVerdict::kBadPayload;
      if (taken == RepairDecoder::Taken::kDuplicate) frame.verdict = FrameVerdict::kDuplicate;
    } else if (const auto version = admit(frame, crc32(frame.payload))) {
      if (newest_ - *version < static_cast<Version>(kWindow))
        repair_.source(frame.header.sequence(), frame.payload, type == MessageType::kMapPacket);
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
    // A repair frame may come before the frame after a group's lost end: that loss is not counted yet.
    const Version version = versionNear(sequence, newest_);
    const auto ahead = static_cast<std::int32_t>(version - newest_);
    if (ahead <= -kWindow || ahead > kMaxGroup) return;
    if (ahead > 0) {
      for (int i = 1; i <= ahead; ++i) slot(newest_ + static_cast<Version>(i)) = State::kMissing;
      counters_.lost += static_cast<std::uint64_t>(ahead);
      newest_ = version;
    }
    if (ship_frames_.holds(version)) return;
    if (slot(version) == State::kMissing) --counters_.lost;
    slot(version) = State::kSeen;
    ship_frames_.add(version, crc32(payload));
    ++counters_.repaired;
    if (!deliver({MessageType::kMapPacket, version, payload})) ++counters_.repaired_invalid;
  });
}

Acknowledgement LinkReceiver::acknowledgement() const {
  std::size_t furthest = Acknowledgement::kMaxReach;
  if (turn_count_ >= kTurnsBack)
    furthest = std::min(furthest, std::size_t{newest_ - turns_[turn_count_ % kTurnsBack]} + kLeastReach);
  return ship_frames_.latest(furthest);
}

}  // namespace fathom::telemetry

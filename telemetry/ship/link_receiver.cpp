#include "telemetry/ship/link_receiver.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <numeric>
#include <vector>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/units.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::int64_t kHour_ns = 3600 * kSecond_ns;
constexpr std::int64_t kSearchInterval_ns = kSecond_ns;
constexpr int kLapsBack = 13;  // of two hours each: a day, and the current one

std::array<std::uint16_t, 3> around(std::uint16_t lap) {
  return {lap, static_cast<std::uint16_t>(lap + 1), static_cast<std::uint16_t>(lap - 1)};
}

constexpr std::size_t kRoomBefore = 1024;  // for frames that come after newer ones
constexpr Version kPiece = 80;             // of the dive, that the smallest downlink frame covers

constexpr std::size_t kLeastReach = 16;  // frames before the oldest turn that are acknowledged
constexpr Version kLap = 0x10000;        // of sequence numbers

}  // namespace

DecodedFrame LapSearch::anyLap(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                               std::int64_t now_ns) {
  if (unconfirmed_) {
    const auto laps = around(*unconfirmed_);
    const DecodedFrame frame = decodeFrame(bytes, tag, laps);
    if (frame.verdict == FrameVerdict::kAccepted) {
      unconfirmed_.reset();
      return frame;
    }
  }
  DecodedFrame refused = peekFrame(bytes);
  refused.verdict = FrameVerdict::kBadTag;
  if (searched_ns_ && std::abs(now_ns - *searched_ns_) < kSearchInterval_ns) return refused;
  searched_ns_ = now_ns;
  std::vector<std::uint16_t> laps(std::size_t{1} << 16);
  std::iota(laps.begin(), laps.end(), std::uint16_t{0});
  const DecodedFrame frame = decodeFrame(bytes, tag, laps);
  if (frame.verdict == FrameVerdict::kAccepted) unconfirmed_ = lapOf(frame.header.version);
  return refused;
}

DecodedFrame LapSearch::decode(std::span<const std::uint8_t> bytes, const FrameTag& tag,
                               std::optional<Version> near, std::int64_t now_ns) {
  if (!keyed_) return decodeFrame(bytes, tag);
  DecodedFrame frame;
  if (near) {
    // The lap that makes the frame nearest to the newest, then those beside it.
    const auto sequence = static_cast<std::uint16_t>(peekFrame(bytes).header.version);
    const auto laps = around(lapOf(versionNear(sequence, *near)));
    frame = decodeFrame(bytes, tag, laps);
    // A repair frame's own tag is shorter, and it follows frames whose lap is known.
    if (frame.verdict != FrameVerdict::kBadTag || frame.header.type == MessageType::kRepair) return frame;
  }
  std::array<std::uint16_t, kLapsBack + 1> recent{};
  for (std::size_t k = 0; k < recent.size(); ++k)
    recent[k] = static_cast<std::uint16_t>(lapOf(firstVersion(now_ns + 2 * kHour_ns)) - k);
  frame = decodeFrame(bytes, tag, recent);
  return frame.verdict == FrameVerdict::kBadTag ? anyLap(bytes, tag, now_ns) : frame;
}

void ShipFrames::addPlace(Version version) {
  if (places_.size() == kMostPlaces) places_.erase(places_.begin() + 1);  // the first is the dive's beginning
  places_.push_back({version, 0});
}

void ShipFrames::add(Version version, std::uint32_t digest) {
  if (digests_.empty()) {
    base_ = version > kRoomBefore ? version - kRoomBefore : 0;
    first_ = newest_ = version;
    addPlace(version);
  }
  if (version < base_) return;
  const std::size_t at = version - base_;
  if (at >= digests_.size()) digests_.resize(at + 1);
  digests_[at] = shortened(digest);
  if (version > newest_ + kLongGap) addPlace(version);
  newest_ = std::max(newest_, version);
  if (version < first_) {
    // The former first frame stays a place: there is a gap before it.
    first_ = version;
    places_.insert(places_.begin(), {version, 0});
    if (places_.size() > kMostPlaces) places_.pop_back();
  }
  if (digests_.size() <= kMost) return;
  constexpr std::size_t kHalf = kMost / 2;
  digests_.erase(digests_.begin(), digests_.begin() + kHalf);
  base_ += kHalf;
  std::erase_if(places_, [this](const Place& place) { return place.version < base_; });
}

void ShipFrames::noteDamage(Version version) {
  addPlace(version);
}

std::uint16_t ShipFrames::lackingBefore(Version version) const {
  if (version <= first_) return Acknowledgement::kAll;
  std::uint16_t lacking = 0;
  while (lacking + 1 < Acknowledgement::kAll && version - lacking > base_ && !holds(version - 1 - lacking))
    ++lacking;
  return lacking;
}

Acknowledgement ShipFrames::before(Version newest, std::size_t furthest) const {
  Acknowledgement a;
  a.valid = true;
  a.newest = static_cast<std::uint16_t>(newest);
  const std::size_t most = std::min({furthest, Acknowledgement::kMaxReach, std::size_t{newest - base_}});
  for (; a.reach < most; ++a.reach) a.before[a.reach] = holds(newest - 1 - static_cast<Version>(a.reach));
  a.lacking = lackingBefore(newest - static_cast<Version>(a.reach));
  return a;
}

Acknowledgement ShipFrames::latest(std::size_t furthest) const {
  return digests_.empty() ? Acknowledgement{} : before(newest_, furthest);
}

std::optional<Acknowledgement> ShipFrames::nextPlace() {
  for (int reports = 0; reports < kReportsOfAPlace; ++reports)
    for (Place& place : places_) {
      // A gap is sent as its length alone, which fits every frame.
      const bool gap = lackingBefore(place.version) >= kLongGap;
      if (place.reports > reports || (!gap && newest_ - place.version < kPiece)) continue;
      ++place.reports;
      return before(place.version, gap ? 0 : Acknowledgement::kMaxReach);
    }
  return std::nullopt;
}

// Continues at reported_, up to which frames were acknowledged in this round.
std::optional<Acknowledgement> ShipFrames::nextPiece() {
  if (digests_.empty() || newest_ == first_) return std::nullopt;
  if (reported_ <= first_ || reported_ > newest_) {
    reported_ = first_ + 1;
    return before(first_, 0);  // no frame came before
  }
  Version last = std::min(reported_ + kPiece - 1, newest_);
  while (last >= reported_ && !holds(last)) --last;
  const bool gap = last < reported_;
  if (gap)
    while (!holds(++last)) {  // the ship has the newest
    }
  reported_ = last + 1;
  return before(last, gap ? 0 : Acknowledgement::kMaxReach);
}

std::optional<Acknowledgement> ShipFrames::further(bool whole_dive) {
  place_next_ = !place_next_ || !whole_dive;
  const auto place = place_next_ ? nextPlace() : std::nullopt;
  return place || !whole_dive ? place : nextPiece();
}

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

#include "telemetry/ship/held_frames.hpp"

#include <algorithm>

namespace fathom::telemetry {
namespace {

constexpr std::size_t kRoomBefore = 1024;  // for frames that come after later ones
constexpr Version kPiece = 80;             // of the dive, that the smallest frame can speak of

}  // namespace

void HeldFrames::addPlace(Version version) {
  if (places_.size() == kMostPlaces) places_.erase(places_.begin() + 1);  // the first is the dive's beginning
  places_.push_back({version, 0});
}

void HeldFrames::hold(Version version, std::uint32_t digest) {
  if (held_.empty()) {
    base_ = version > kRoomBefore ? version - kRoomBefore : 0;
    first_ = newest_ = version;
    addPlace(version);
  }
  if (version < base_) return;
  const std::size_t at = version - base_;
  if (at >= held_.size()) held_.resize(at + 1);
  held_[at] = shortened(digest);
  if (version > newest_ + kLongGap) addPlace(version);
  newest_ = std::max(newest_, version);
  if (version < first_) {
    // What was the first stays a place: there is a gap before it.
    first_ = version;
    places_.insert(places_.begin(), {version, 0});
    if (places_.size() > kMostPlaces) places_.pop_back();
  }
  if (held_.size() <= kMost) return;
  constexpr std::size_t kHalf = kMost / 2;
  held_.erase(held_.begin(), held_.begin() + kHalf);
  base_ += kHalf;
  std::erase_if(places_, [this](const Place& place) { return place.version < base_; });
}

void HeldFrames::noteDamage(Version version) {
  addPlace(version);
}

std::uint16_t HeldFrames::lackingBefore(Version version) const {
  if (version <= first_) return Acknowledgement::kAll;
  std::uint16_t lacking = 0;
  while (lacking + 1 < Acknowledgement::kAll && version - lacking > base_ && !holds(version - 1 - lacking))
    ++lacking;
  return lacking;
}

Acknowledgement HeldFrames::before(Version newest, std::size_t furthest) const {
  Acknowledgement a;
  a.valid = true;
  a.newest = static_cast<std::uint16_t>(newest);
  const std::size_t most = std::min({furthest, Acknowledgement::kMaxReach, std::size_t{newest - base_}});
  for (; a.reach < most; ++a.reach) a.before[a.reach] = holds(newest - 1 - static_cast<Version>(a.reach));
  a.lacking = lackingBefore(newest - static_cast<Version>(a.reach));
  return a;
}

Acknowledgement HeldFrames::latest(std::size_t furthest) const {
  return held_.empty() ? Acknowledgement{} : before(newest_, furthest);
}

std::optional<Acknowledgement> HeldFrames::nextPlace() {
  for (int told = 0; told < kTellings; ++told)
    for (Place& place : places_) {
      // A gap is told by its length alone, which fits every frame.
      const bool gap = lackingBefore(place.version) >= kLongGap;
      if (place.told > told || (!gap && newest_ - place.version < kPiece)) continue;
      ++place.told;
      return before(place.version, gap ? 0 : Acknowledgement::kMaxReach);
    }
  return std::nullopt;
}

// Frames before told_ have been spoken of in this round.
std::optional<Acknowledgement> HeldFrames::nextPiece() {
  if (held_.empty() || newest_ == first_) return std::nullopt;
  if (told_ <= first_ || told_ > newest_) {
    told_ = first_ + 1;
    return before(first_, 0);  // nothing came before
  }
  Version last = std::min(told_ + kPiece - 1, newest_);
  while (last >= told_ && !holds(last)) --last;
  const bool gap = last < told_;
  if (gap)
    while (!holds(++last)) {  // the newest is held
    }
  told_ = last + 1;
  return before(last, gap ? 0 : Acknowledgement::kMaxReach);
}

std::optional<Acknowledgement> HeldFrames::further(bool whole_dive) {
  place_next_ = !place_next_ || !whole_dive;
  const auto place = place_next_ ? nextPlace() : std::nullopt;
  return place || !whole_dive ? place : nextPiece();
}

}  // namespace fathom::telemetry

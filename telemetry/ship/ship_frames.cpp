#include "telemetry/ship/ship_frames.hpp"

#include <algorithm>

namespace fathom::telemetry {
namespace {

constexpr std::size_t kRoomBefore = 1024;  // for frames that come after newer ones
constexpr Version kPiece = 80;             // of the dive, that the smallest downlink frame covers

}  // namespace

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

}  // namespace fathom::telemetry

// BlockQueue: what it can be asked.
#include <algorithm>

#include "telemetry/vehicle/block_queue.hpp"

namespace fathom::telemetry {

bool BlockQueue::hasRoom() const {
  return std::any_of(squares_.begin(), squares_.end(), [](const Square& s) {
    return !s.used || std::none_of(s.blocks.begin(), s.blocks.end(), [](const Block& b) { return b.wanted; });
  });
}

bool BlockQueue::owes(double north_min, double north_max, double east_min, double east_max,
                      double spacing) const {
  const auto code = spacingCode(spacing);
  const double side = spacing * MapBlock::kSide;
  const auto within = [side](std::int32_t index, double least, double most) {
    return (index + 1) * side >= least && index * side <= most;
  };
  for (const Square& s : squares_)
    for (const Block& b : s.blocks)
      if (s.used && s.spacing == code && (b.wanted || b.state == State::kInFlight) &&
          within(b.content.key.north, north_min, north_max) && within(b.content.key.east, east_min, east_max))
        return true;
  return false;
}

void BlockQueue::eachHeld(
    const std::function<void(const BlockKey&, Version, Version, const MapBlock&)>& visit) const {
  for (const Square& s : squares_)
    for (const Block& b : s.blocks) {
      if (!s.used || b.state != State::kDelivered) continue;
      MapBlock shown;
      shown.key = b.content.key;
      shown.seen = b.held_seen;
      shown.depth = b.held;
      visit(shown.key, b.first, b.last, shown);
    }
}

BlockQueue::Census BlockQueue::census(int sendings) const {
  Census c;
  for (const Square& s : squares_) {
    c.squares += s.used ? 1 : 0;
    for (const Block& b : s.blocks) {
      if (!s.used) continue;
      const bool coarse = s.spacing == coarse_ && coarse_ != fine_;
      c.waiting += b.wanted && (!coarse || fineIsLate(b, now_ns_)) ? 1 : 0;
      c.in_flight += b.state == State::kInFlight ? 1 : 0;
      c.unsure += b.state == State::kInFlight && b.sendings < sendings ? 1 : 0;
    }
  }
  return c;
}

std::size_t BlockQueue::memoryBytes() const {
  return squares_.size() * sizeof(Square) + remembered_.capacity() * sizeof(Remembered) +
         index_.memoryBytes();
}

}  // namespace fathom::telemetry

// BlockQueue: which blocks go next, and what it holds.
#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "realtime/base/units.hpp"
#include "telemetry/vehicle/block_queue.hpp"

namespace fathom::telemetry {
// Whether a block has stopped changing: one in view grows with every pair and would be sent again at once.
bool BlockQueue::settled(const Block& b, std::int64_t now_ns) const {
  if (b.state == State::kLost && b.content.seen == b.held_seen) return true;
  if (b.held_seen == 0 && b.content.seen == MapBlock::kWhole) return true;
  return rt::seconds(now_ns - b.changed_ns) >= config_.settle_s ||
         rt::seconds(now_ns - b.since_ns) >= config_.max_wait_s;
}

bool BlockQueue::fineIsLate(const Block& coarse, std::int64_t now_ns) const {
  if (coarse.orphan) return true;
  // The fine blocks under it, square by square.
  const std::int32_t n0 = coarse.content.key.north * ratio_, e0 = coarse.content.key.east * ratio_;
  const auto under = [&](const Block& b) {
    return b.content.key.north >= n0 && b.content.key.north < n0 + ratio_ && b.content.key.east >= e0 &&
           b.content.key.east < e0 + ratio_;
  };
  for (std::int32_t n = floorDiv(n0, kBlocksASide); n <= floorDiv(n0 + ratio_ - 1, kBlocksASide); ++n)
    for (std::int32_t e = floorDiv(e0, kBlocksASide); e <= floorDiv(e0 + ratio_ - 1, kBlocksASide); ++e) {
      const auto slot = index_.find(fine_, n, e);
      if (!slot) continue;
      for (const Block& b : squares_[*slot].blocks)
        if (b.wanted && b.held_seen == 0 && under(b) &&
            rt::seconds(now_ns - b.since_ns) >= config_.coarse_after_s)
          return true;
    }
  return false;
}

bool BlockQueue::coarseIsHeld(const Block& fine) const {
  if (coarse_ == fine_) return false;
  const std::int32_t n = floorDiv(fine.content.key.north, ratio_),
                     e = floorDiv(fine.content.key.east, ratio_);
  const auto slot = index_.find(coarse_, floorDiv(n, kBlocksASide), floorDiv(e, kBlocksASide));
  if (!slot) return false;
  const auto& blocks = squares_[*slot].blocks;
  return std::any_of(blocks.begin(), blocks.end(), [&](const Block& b) {
    return b.content.key.north == n && b.content.key.east == e && b.held_seen != 0 && b.state != State::kLost;
  });
}

BlockQueue::Urgency BlockQueue::urgency(const Square& s, const Block& b, std::int64_t now_ns) const {
  if (!b.wanted && b.state == State::kInFlight && b.sendings < sendings_ &&
      now_ns - b.sent_ns >= repeat_after_ns_)
    return Urgency::kRepeat;
  if (!b.wanted || !settled(b, now_ns)) return Urgency::kNone;
  if (s.spacing == coarse_ && coarse_ != fine_) {
    if (fineIsLate(b, now_ns)) return Urgency::kNewCoarse;
    return b.last != 0 ? Urgency::kRefine : Urgency::kNone;  // the ship shows it
  }
  const bool requested = s.spacing != fine_ || s.max_error < config_.max_error * (1 - 1e-6);
  if (b.state == State::kLost && !requested && rt::seconds(now_ns - b.since_ns) < config_.deadline_s)
    return Urgency::kRetry;
  if (requested) return Urgency::kRequested;
  if (b.state != State::kLost && b.held_seen != 0 && (b.content.seen & ~b.held_seen) == 0)
    return Urgency::kChanged;
  if (b.held_seen == 0 && coarseIsHeld(b)) return Urgency::kRefine;
  return Urgency::kNew;
}

BlockQueue::Best BlockQueue::mostUrgent(std::int64_t now_ns) const {
  Best best;
  std::int64_t best_since = 0;
  for (std::size_t i = 0; i < squares_.size(); ++i) {
    if (!squares_[i].used) continue;
    for (std::size_t k = 0; k < 16; ++k) {
      const Block& b = squares_[i].blocks[k];
      const Urgency u = urgency(squares_[i], b, now_ns);
      if (u == Urgency::kNone || u > best.urgency) continue;
      // The newest; of the unacknowledged ones the one sent longest ago.
      const std::int64_t since = u == Urgency::kRepeat ? -b.sent_ns : b.since_ns;
      if (u == best.urgency && since <= best_since) continue;
      best = {u, i, k};
      best_since = since;
    }
  }
  return best;
}

bool BlockQueue::ready(std::int64_t now_ns) const {
  return mostUrgent(now_ns).urgency < Urgency::kRepeat;
}

template <class Visit>
void BlockQueue::eachCandidate(const Square& seed, std::int64_t now_ns, Visit visit) const {
  for (std::size_t i = 0; i < squares_.size(); ++i) {
    const Square& s = squares_[i];
    if (!s.used || s.spacing != seed.spacing || s.max_error != seed.max_error ||
        std::abs(s.north - seed.north) > 1 || std::abs(s.east - seed.east) > 1)
      continue;
    for (std::size_t k = 0; k < 16; ++k) {
      const Urgency u = urgency(s, s.blocks[k], now_ns);
      if (u != Urgency::kNone) visit(i, k, u);
    }
  }
}

void BlockQueue::repeat(int sendings, double after_s) {
  sendings_ = std::clamp(sendings, 1, 200);
  repeat_after_ns_ = rt::nanoseconds(after_s);
}

bool BlockQueue::gather(std::int64_t now_ns, std::size_t limit, Batch& batch) {
  now_ns_ = std::max(now_ns_, now_ns);
  batch.size = 0;
  const Best best = mostUrgent(now_ns_);
  if (best.urgency == Urgency::kNone) return false;
  struct Candidate {
    std::size_t square, block;
    int rank;  // as urgent as the first block, or nearly: 0; a repeat: 2
    std::int32_t north, east;
  };
  std::array<Candidate, 9 * 16> candidates;
  std::size_t count = 0;
  const Square& seed = squares_[best.square];
  const Urgency still_urgent = std::max(best.urgency, Urgency::kNew);
  eachCandidate(seed, now_ns_, [&](std::size_t i, std::size_t k, Urgency u) {
    if (i == best.square && k == best.block) return;
    const BlockKey& key = squares_[i].blocks[k].content.key;
    candidates[count++] = {i, k, u == Urgency::kRepeat ? 2 : u <= still_urgent ? 0 : 1, key.north, key.east};
  });
  std::int32_t n0 = 0, n1 = 0, e0 = 0, e1 = 0;
  const auto take = [&](std::size_t i, std::size_t k) {
    const Block& b = squares_[i].blocks[k];
    const BlockKey& key = b.content.key;
    n0 = batch.size == 0 ? key.north : std::min(n0, key.north);
    n1 = batch.size == 0 ? key.north : std::max(n1, key.north);
    e0 = batch.size == 0 ? key.east : std::min(e0, key.east);
    e1 = batch.size == 0 ? key.east : std::max(e1, key.east);
    batch.blocks[batch.size] = b.content;
    batch.refs[batch.size++] = {static_cast<std::uint32_t>(i), static_cast<std::uint8_t>(k)};
  };
  batch.max_error = seed.max_error;
  batch.repeats = best.urgency == Urgency::kRepeat && !seed.blocks[best.block].blocked;
  take(best.square, best.block);
  const BlockKey first = batch.blocks[0].key;
  while (batch.size < std::min(limit, kMaxBatch) && count > 0) {
    // The one that widens the packet's rectangle least, then the nearest to the first.
    const auto cost = [&](const Candidate& c) {
      const std::int32_t rows = std::max(n1, c.north) - std::min(n0, c.north) + 1;
      const std::int32_t cols = std::max(e1, c.east) - std::min(e0, c.east) + 1;
      const std::int32_t dn = c.north - first.north, de = c.east - first.east;
      return std::tuple(c.rank, rows * cols, dn * dn + de * de, c.north, c.east);
    };
    const auto next =
        std::min_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count),
                         [&](const Candidate& a, const Candidate& b) { return cost(a) < cost(b); });
    take(next->square, next->block);
    *next = candidates[--count];
  }
  return true;
}

bool BlockQueue::hasRoom() const {
  return std::any_of(squares_.begin(), squares_.end(), [](const Square& s) {
    return !s.used || std::none_of(s.blocks.begin(), s.blocks.end(), [](const Block& b) { return b.wanted; });
  });
}

bool BlockQueue::hasPending(double north_min, double north_max, double east_min, double east_max,
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
      c.in_repeat += b.state == State::kInFlight && b.sendings < sendings ? 1 : 0;
    }
  }
  return c;
}

std::size_t BlockQueue::memoryBytes() const {
  return squares_.size() * sizeof(Square) + remembered_.capacity() * sizeof(Remembered) +
         index_.memoryBytes();
}

}  // namespace fathom::telemetry

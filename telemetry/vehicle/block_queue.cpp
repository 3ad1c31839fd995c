#include "telemetry/vehicle/block_queue.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <tuple>

namespace fathom::telemetry {
namespace {

SpacingCode codeOf(double spacing, const char* what) {
  const auto code = spacingCode(spacing);
  if (!code) throw std::invalid_argument(what);
  return *code;
}

// Block (bi, bj) of a tile; nodes seen less than min_coverage are left out.
MapBlock blockOf(const HeightTile& tile, SpacingCode spacing, int bi, int bj, double min_coverage) {
  MapBlock block;
  block.key = {spacing, tile.north_index * kBlocksASide + bi, tile.east_index * kBlocksASide + bj};
  for (int n = 0; n < MapBlock::kNodes; ++n) {
    const HeightTile::Node& node =
        tile.at(bi * MapBlock::kSide + n / MapBlock::kSide, bj * MapBlock::kSide + n % MapBlock::kSide);
    if (!(static_cast<double>(node.coverage) >= min_coverage) || !std::isfinite(node.depth)) continue;
    const auto k = static_cast<std::size_t>(n);
    block.seen = static_cast<std::uint16_t>(block.seen | 1U << n);
    block.depth[k] = node.depth;
    block.colour[k] = node.colour;
    block.sigma = std::max(block.sigma, node.sigma);
  }
  return block;
}

bool differ(const std::array<float, MapBlock::kNodes>& a, const std::array<float, MapBlock::kNodes>& b,
            std::uint16_t seen, double bound) {
  for (std::size_t n = 0; n < MapBlock::kNodes; ++n)
    if ((seen >> n & 1U) != 0 && !(std::abs(static_cast<double>(a[n]) - static_cast<double>(b[n])) <= bound))
      return true;
  return false;
}

}  // namespace

void BlockQueueConfig::validate() const {
  requireBounds(max_squares >= 1 && max_squares <= 1'000'000, "max_squares is outside 1 to 1000000");
  requireBounds(spacing >= 0.0078125 && spacing <= 64, "spacing_m is outside 1/128 to 64 m");
  const double ratio = coarse_spacing / spacing;
  requireBounds(ratio >= 1 && ratio <= 64 && ratio == std::round(ratio),
                "coarse_spacing_m is not a whole multiple of spacing_m, up to 64");
  requireBounds(max_error >= 0.001 && max_error <= 10, "max_error_m is outside 0.001 to 10 m");
  requireBounds(update_error >= max_error && update_error <= 100,
                "update_error_m is outside max_error_m to 100 m");
  requireBounds(min_coverage >= 0 && min_coverage <= 1, "min_coverage is outside 0 to 1");
  requireBounds(settle_s >= 0 && settle_s <= 600, "settle_s is outside 0 to 600 s");
  requireBounds(max_wait_s >= settle_s && max_wait_s <= 3600, "max_wait_s is outside settle_s to 3600 s");
  requireBounds(deadline_s >= 0 && deadline_s <= 3600, "deadline_s is outside 0 to 3600 s");
  requireBounds(coarse_after_s >= 0 && coarse_after_s <= 3600, "coarse_after_s is outside 0 to 3600 s");
}

BlockQueue::BlockQueue(const BlockQueueConfig& config)
    : config_(config),
      fine_(codeOf(config.spacing, "spacing has no code: give a power of two or whole millimetres")),
      coarse_(codeOf(config.coarse_spacing,
                     "coarse spacing has no code: give a power of two or whole millimetres")),
      ratio_(static_cast<int>(std::lround(config.coarse_spacing / config.spacing))),
      squares_(static_cast<std::size_t>(config.max_squares)),
      index_(squares_.size()) {
  remembered_.reserve(squares_.size() * kRememberedASquare);
}

// Remembers which frames carried the square's blocks: the ship may show them until it acknowledges that they
// were withdrawn.
void BlockQueue::remember(const Square& s) {
  Remembered r{s.spacing, s.north, s.east, 0, {}};
  bool unsent = false, unacknowledged = false;
  for (std::size_t k = 0; k < s.blocks.size(); ++k) {
    const Block& b = s.blocks[k];
    const bool delivered = b.state == State::kDelivered;
    unsent = unsent || b.wanted;
    unacknowledged = unacknowledged || b.state == State::kInFlight;
    // A ship that has lost the withdrawal may still receive an older frame of the block.
    if (b.last == 0 || (delivered && b.held_seen == 0 && b.has < oldest_)) continue;
    r.version[k] = delivered ? b.has : b.last;
    if (delivered) r.has = static_cast<std::uint16_t>(r.has | 1U << k);
  }
  if (on_evicted_ && (unsent || unacknowledged)) on_evicted_({s.spacing, s.north, s.east}, !unsent);
  if (r.version == decltype(r.version){}) return;
  if (remembered_.size() == remembered_.capacity()) {
    ++counters_.forgotten;
    return;
  }
  remembered_.insert(std::lower_bound(remembered_.begin(), remembered_.end(), r), r);
}

void BlockQueue::recall(Square& s) {
  const Remembered place{s.spacing, s.north, s.east, 0, {}};
  const auto found = std::lower_bound(remembered_.begin(), remembered_.end(), place);
  if (found == remembered_.end() || place < *found) return;
  for (std::size_t k = 0; k < s.blocks.size(); ++k) {
    if (found->version[k] == 0) continue;
    Block& b = s.blocks[k];
    b.first = b.last = found->version[k];
    markUnknown(b);
  }
  remembered_.erase(found);
}

void BlockQueue::evict(std::size_t slot) {
  Square& s = squares_[slot];
  remember(s);
  for (const Block& b : s.blocks) {
    if (!b.wanted) continue;
    ++counters_.evicted;
    if (s.spacing != fine_ || coarse_ == fine_) continue;
    // The coarse block alone is left of this area.
    const std::int32_t n = floorDiv(b.content.key.north, ratio_), e = floorDiv(b.content.key.east, ratio_);
    if (const auto c = index_.find(coarse_, floorDiv(n, kBlocksASide), floorDiv(e, kBlocksASide)))
      for (Block& coarse : squares_[*c].blocks)
        if (coarse.content.key.north == n && coarse.content.key.east == e) coarse.orphan = true;
  }
  s = Square{};
  index_.clear();
  for (std::size_t i = 0; i < squares_.size(); ++i)
    if (squares_[i].used) index_.add(squares_[i].spacing, squares_[i].north, squares_[i].east, i);
}

std::size_t BlockQueue::slotFor(SpacingCode spacing, std::int32_t north, std::int32_t east) {
  if (const auto known = index_.find(spacing, north, east)) return *known;
  const auto rank = [](const Square& s) {
    const bool idle = std::none_of(s.blocks.begin(), s.blocks.end(), [](const Block& b) { return b.wanted; });
    return std::tuple(!s.used ? 0 : idle ? 1 : 2, s.order);
  };
  std::size_t best = 0;
  for (std::size_t i = 1; i < squares_.size(); ++i)
    if (rank(squares_[i]) < rank(squares_[best])) best = i;
  if (squares_[best].used) evict(best);
  Square& s = squares_[best];
  s.used = true;
  s.spacing = spacing;
  s.north = north;
  s.east = east;
  s.max_error = config_.max_error;
  recall(s);
  index_.add(spacing, north, east, best);
  return best;
}

// Whether the block's content should be sent: the ship has fewer nodes of it, or other depths.
bool BlockQueue::differs(const Square& square, const Block& b) const {
  if (b.content.seen != b.held_seen) return true;
  if (b.content.seen == 0) return false;
  // Of content sent more than once the ship may show any sending, from the acknowledged one on.
  const double spread = b.moved && b.has != b.last ? static_cast<double>(b.spread) : 0;
  const double bound = std::max(0.0, config_.update_error * square.max_error / config_.max_error - spread);
  return static_cast<double>(b.held_error) > square.max_error * (1 + 1e-6) ||
         differ(b.content.depth, b.held, b.content.seen, bound);
}

void BlockQueue::judge(const Square& square, Block& b, std::int64_t now_ns) {
  const bool wanted = !b.blocked && (b.state == State::kLost || differs(square, b));
  if (wanted && !b.wanted) {
    b.since_ns = now_ns;
    ++counters_.offered;
  }
  b.wanted = wanted;
}

void BlockQueue::offer(const HeightTile& tile, double max_error, std::int64_t now_ns) {
  const auto spacing = spacingCode(tile.spacing());
  if (!spacing || !(max_error > 0)) {
    ++counters_.refused;
    return;
  }
  now_ns_ = std::max(now_ns_, now_ns);
  std::array<MapBlock, 16> blocks;
  const Remembered place{*spacing, tile.north_index, tile.east_index, 0, {}};
  bool anything = index_.find(*spacing, tile.north_index, tile.east_index).has_value() ||
                  std::binary_search(remembered_.begin(), remembered_.end(), place);
  for (int k = 0; k < 16; ++k) {
    blocks[static_cast<std::size_t>(k)] =
        blockOf(tile, *spacing, k / kBlocksASide, k % kBlocksASide, config_.min_coverage);
    anything = anything || blocks[static_cast<std::size_t>(k)].seen != 0;
  }
  if (!anything) return;
  Square& s = squares_[slotFor(*spacing, tile.north_index, tile.east_index)];
  s.order = ++order_;
  s.max_error = std::min(s.max_error, max_error);
  // Smaller changes are those of a mean with one more observation.
  const double still = config_.update_error / 4;
  for (std::size_t k = 0; k < 16; ++k) {
    Block& b = s.blocks[k];
    if (blocks[k].seen != b.content.seen || differ(blocks[k].depth, b.content.depth, blocks[k].seen, still)) {
      b.changed_ns = now_ns_;
      b.blocked = false;
    }
    b.moved = b.moved || blocks[k].seen != b.content.seen ||
              differ(blocks[k].depth, b.content.depth, blocks[k].seen, 0);
    b.content = blocks[k];
    judge(s, b, now_ns_);
  }
}

void BlockQueue::sent(const Batch& batch, std::size_t count, std::span<const MapBlock> decoded,
                      Version version) {
  for (std::size_t k = 0; k < count; ++k) {
    Block& b = at(batch.refs[k]);
    ++counters_.sent;
    const bool repeat = !b.wanted && b.state == State::kInFlight;
    if (repeat)
      ++counters_.repeated;
    else if (b.state == State::kLost)
      ++counters_.resent;
    else if (b.held_seen != 0)
      ++counters_.updated;
    // After a move, earlier sendings that may still arrive are of other content.
    if (!repeat || b.moved || decoded[k].seen != b.held_seen) {
      b.first = version;
      b.spread = 0;
      b.has = 0;
      b.flying = b.sendings = 0;
    }
    if (b.first != version)
      for (std::size_t n = 0; n < MapBlock::kNodes; ++n)
        if ((b.held_seen >> n & 1U) != 0)
          b.spread = std::max(b.spread, std::abs(decoded[k].depth[n] - b.held[n]));
    b.last = version;
    ++b.flying;
    ++b.sendings;
    b.sent_ns = now_ns_;
    b.state = State::kInFlight;
    b.held = decoded[k].depth;
    b.held_seen = decoded[k].seen;
    b.held_error = static_cast<float>(batch.max_error);
    b.orphan = b.moved = false;
    b.wanted = false;
    b.blocked = decoded[k].seen != batch.blocks[k].seen;
    judge(squares_[batch.refs[k].square], b, now_ns_);
  }
}

void BlockQueue::unsendable(const Batch& batch) {
  Block& b = at(batch.refs[0]);
  if (batch.repeats && b.moved && b.content.seen == b.held_seen) {
    b.content.depth = b.held;
    b.moved = false;
    return;
  }
  b.sendings = std::numeric_limits<decltype(b.sendings)>::max();
  if (batch.repeats) return;
  b.blocked = true;
  b.wanted = false;
  ++counters_.unsendable;
}

std::optional<BlockQueue::Whole> BlockQueue::delivered(const BlockRef& ref, Version version) {
  Block& b = at(ref);
  if (version < b.first || version > b.last || b.state == State::kNever) return std::nullopt;
  b.state = State::kDelivered;
  b.has = std::max(b.has, version);
  Square& square = squares_[ref.square];
  b.wanted = !b.blocked && differs(square, b);
  for (const Block& other : square.blocks)
    if (other.content.seen != 0 && (other.state != State::kDelivered || other.wanted || other.blocked))
      return std::nullopt;
  square.max_error = config_.max_error;  // the request for a finer error is served
  return Whole{square.spacing, square.north, square.east};
}

void BlockQueue::settle(const Holds& holds, Version oldest) {
  oldest_ = oldest;
  for (Square& s : squares_) {
    if (!s.used) continue;
    for (std::size_t k = 0; k < s.blocks.size(); ++k) {
      Block& b = s.blocks[k];
      const bool had = b.state == State::kDelivered;
      if (!had && !(b.state == State::kInFlight && b.last < oldest)) continue;
      const auto held = holds(had ? b.has : b.last);
      if (had ? held.value_or(true) : held.value_or(false)) {
        if (!had) {
          b.state = State::kDelivered;
          b.has = b.last;
          judge(s, b, now_ns_);
        }
        continue;
      }
      if (had) ++counters_.missed;
      b.flying = 0;
      makeLost(b);
    }
  }
  for (Remembered& r : remembered_) settle(r, holds, oldest);
}

void BlockQueue::settle(Remembered& r, const Holds& holds, Version oldest) {
  bool lacks = false;
  for (std::size_t k = 0; k < r.version.size(); ++k) {
    if (r.version[k] == 0) continue;
    const bool had = (r.has >> k & 1U) != 0;
    const auto held = holds(r.version[k]);
    if (held.value_or(had)) {
      r.has = static_cast<std::uint16_t>(r.has | 1U << k);
      continue;
    }
    if (!had && !held && r.version[k] >= oldest) continue;  // may still be acknowledged
    if (had) ++counters_.missed;
    r.has = static_cast<std::uint16_t>(r.has & ~(1U << k));
    lacks = true;
  }
  if (lacks && on_evicted_) on_evicted_({r.spacing, r.north, r.east}, false);
}

void BlockQueue::noteUnknownFrames() {
  for (Square& s : squares_)
    for (Block& b : s.blocks)
      if (s.used && b.wanted) markUnknown(b);
}

void BlockQueue::markUnknown(Block& b) {
  b.held_seen = MapBlock::kWhole;
  b.held.fill(std::numeric_limits<float>::quiet_NaN());
}

bool BlockQueue::expireOldest() {
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  const auto flies = [](const Square& s, const Block& b) { return s.used && b.state == State::kInFlight; };
  for (const Square& s : squares_)
    for (const Block& b : s.blocks)
      if (flies(s, b)) first = std::min(first, b.sent_ns);
  for (Square& s : squares_)
    for (Block& b : s.blocks)
      if (flies(s, b) && b.sent_ns == first) {
        b.state = State::kLost;
        b.wanted = true;
        b.blocked = false;
      }
  return first != std::numeric_limits<std::int64_t>::max();
}

void BlockQueue::makeLost(Block& b) {
  b.state = State::kLost;
  b.blocked = false;
  b.has = 0;
  if (b.wanted) return;
  b.wanted = true;
  ++counters_.offered;
}

void BlockQueue::lost(const BlockRef& ref, Version version) {
  Block& b = at(ref);
  if (version < b.first || version > b.last || b.state != State::kInFlight) return;
  if (b.flying > 0 && --b.flying > 0) return;  // another sending of the same may have arrived
  makeLost(b);
}

}  // namespace fathom::telemetry

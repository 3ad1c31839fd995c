#include "telemetry/block_queue.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

namespace fathom::telemetry {
namespace {

constexpr int kBlocksASide = HeightTile::kCells / MapBlock::kSide;  // of a square
constexpr std::uint16_t kWhole = 0xFFFF;

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

std::int32_t floorDiv(std::int32_t a, std::int32_t b) {
  return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);
}

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
  const auto require = [](bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
  };
  require(max_squares >= 1 && max_squares <= 1'000'000, "max_squares is outside 1 to 1000000");
  require(spacing >= 0.0078125 && spacing <= 64, "spacing_m is outside 1/128 to 64 m");
  const double ratio = coarse_spacing / spacing;
  require(ratio >= 1 && ratio <= 64 && ratio == std::round(ratio),
          "coarse_spacing_m is not a whole multiple of spacing_m, up to 64");
  require(max_error >= 0.001 && max_error <= 10, "max_error_m is outside 0.001 to 10 m");
  require(update_error >= max_error && update_error <= 100, "update_error_m is outside max_error_m to 100 m");
  require(min_coverage >= 0 && min_coverage <= 1, "min_coverage is outside 0 to 1");
  require(settle_s >= 0 && settle_s <= 600, "settle_s is outside 0 to 600 s");
  require(max_wait_s >= settle_s && max_wait_s <= 3600, "max_wait_s is outside settle_s to 3600 s");
  require(deadline_s >= 0 && deadline_s <= 3600, "deadline_s is outside 0 to 3600 s");
  require(coarse_after_s >= 0 && coarse_after_s <= 3600, "coarse_after_s is outside 0 to 3600 s");
}

BlockQueue::BlockQueue(const BlockQueueConfig& config)
    : config_(config),
      fine_(codeOf(config.spacing, "spacing has no code: give a power of two or whole millimetres")),
      coarse_(codeOf(config.coarse_spacing,
                     "coarse spacing has no code: give a power of two or whole millimetres")),
      ratio_(static_cast<int>(std::lround(config.coarse_spacing / config.spacing))),
      squares_(static_cast<std::size_t>(config.max_squares)),
      index_(squares_.size()) {}

void BlockQueue::giveWay(std::size_t slot) {
  Square& s = squares_[slot];
  for (const Block& b : s.blocks) {
    if (!b.wanted) continue;
    ++counters_.evicted;
    if (s.spacing != fine_ || coarse_ == fine_) continue;
    // Its area has only the coarse block left.
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
  if (squares_[best].used) giveWay(best);
  Square& s = squares_[best];
  s.used = true;
  s.spacing = spacing;
  s.north = north;
  s.east = east;
  s.max_error = config_.max_error;
  index_.add(spacing, north, east, best);
  return best;
}

// Whether the other side should get the block's content: it holds less, or something else.
bool BlockQueue::differs(const Square& square, const Block& b) const {
  if (b.content.seen != b.held_seen) return true;
  if (b.content.seen == 0) return false;
  const double bound = config_.update_error * square.max_error / config_.max_error;
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
  bool anything = index_.find(*spacing, tile.north_index, tile.east_index).has_value();
  for (int k = 0; k < 16; ++k) {
    blocks[static_cast<std::size_t>(k)] =
        blockOf(tile, *spacing, k / kBlocksASide, k % kBlocksASide, config_.min_coverage);
    anything = anything || blocks[static_cast<std::size_t>(k)].seen != 0;
  }
  if (!anything) return;
  Square& s = squares_[slotFor(*spacing, tile.north_index, tile.east_index)];
  s.order = ++order_;
  s.max_error = std::min(s.max_error, max_error);
  // Smaller changes are those of an average that takes in one more observation.
  const double still = config_.update_error / 4;
  for (std::size_t k = 0; k < 16; ++k) {
    Block& b = s.blocks[k];
    if (blocks[k].seen != b.content.seen || differ(blocks[k].depth, b.content.depth, blocks[k].seen, still)) {
      b.changed_ns = now_ns_;
      b.blocked = false;
    }
    b.content = blocks[k];
    judge(s, b, now_ns_);
  }
}

// A block in view grows with every pair; sent now it would have to be sent again at once.
bool BlockQueue::settled(const Block& b, std::int64_t now_ns) const {
  if (b.state == State::kLost && b.content.seen == b.held_seen) return true;
  if (b.held_seen == 0 && b.content.seen == kWhole) return true;
  return seconds(now_ns - b.changed_ns) >= config_.settle_s ||
         seconds(now_ns - b.since_ns) >= config_.max_wait_s;
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
            seconds(now_ns - b.since_ns) >= config_.coarse_after_s)
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
  if (!b.wanted || !settled(b, now_ns)) return Urgency::kNone;
  if (s.spacing == coarse_ && coarse_ != fine_)
    return fineIsLate(b, now_ns) ? Urgency::kNewCoarse : Urgency::kNone;
  const bool requested = s.spacing != fine_ || s.max_error < config_.max_error * (1 - 1e-6);
  if (b.state == State::kLost)
    return seconds(now_ns - b.since_ns) < config_.deadline_s && !requested ? Urgency::kRetry
                                                                           : Urgency::kResend;
  if (requested) return Urgency::kRequested;
  if (b.held_seen != 0 && (b.content.seen & ~b.held_seen) == 0) return Urgency::kChanged;
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
      if (!b.wanted || b.content.seen == 0) continue;  // an emptied block travels with a neighbour
      const Urgency u = urgency(squares_[i], b, now_ns);
      if (u == Urgency::kNone || u > best.urgency || (u == best.urgency && b.since_ns <= best_since))
        continue;
      best = {u, i, k};
      best_since = b.since_ns;
    }
  }
  return best;
}

bool BlockQueue::ready(std::int64_t now_ns) const {
  return mostUrgent(now_ns).urgency != Urgency::kNone;
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

bool BlockQueue::gather(std::int64_t now_ns, std::size_t limit, Batch& batch) {
  now_ns_ = std::max(now_ns_, now_ns);
  batch.size = 0;
  const Best best = mostUrgent(now_ns_);
  if (best.urgency == Urgency::kNone) return false;
  struct Candidate {
    std::size_t square, block;
    bool urgent;  // as urgent as the first block, or nearly
    std::int32_t north, east;
  };
  std::array<Candidate, 9 * 16> candidates;
  std::size_t count = 0;
  const Square& seed = squares_[best.square];
  const Urgency still_urgent = std::max(best.urgency, Urgency::kNew);
  eachCandidate(seed, now_ns_, [&](std::size_t i, std::size_t k, Urgency u) {
    if (i == best.square && k == best.block) return;
    const BlockKey& key = squares_[i].blocks[k].content.key;
    candidates[count++] = {i, k, u <= still_urgent, key.north, key.east};
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
    batch.refs[batch.size++] = {static_cast<std::uint32_t>(i), 0, static_cast<std::uint8_t>(k)};
  };
  batch.max_error = seed.max_error;
  take(best.square, best.block);
  const BlockKey first = batch.blocks[0].key;
  while (batch.size < std::min(limit, kMaxBatch) && count > 0) {
    // The one that widens the packet's rectangle least, then the nearest to the first.
    const auto cost = [&](const Candidate& c) {
      const std::int32_t rows = std::max(n1, c.north) - std::min(n0, c.north) + 1;
      const std::int32_t cols = std::max(e1, c.east) - std::min(e0, c.east) + 1;
      const std::int32_t dn = c.north - first.north, de = c.east - first.east;
      return std::tuple(!c.urgent, rows * cols, dn * dn + de * de, c.north, c.east);
    };
    const auto next =
        std::min_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count),
                         [&](const Candidate& a, const Candidate& b) { return cost(a) < cost(b); });
    take(next->square, next->block);
    *next = candidates[--count];
  }
  return true;
}

void BlockQueue::sent(Batch& batch, std::size_t count, std::span<const MapBlock> decoded, bool coarsened) {
  for (std::size_t k = 0; k < count; ++k) {
    Block& b = at(batch.refs[k]);
    ++counters_.sent;
    if (b.state == State::kLost)
      ++counters_.resent;
    else if (b.held_seen != 0)
      ++counters_.updated;
    batch.refs[k].stamp = b.stamp = ++stamp_;
    b.state = State::kInFlight;
    b.held = decoded[k].depth;
    b.held_seen = decoded[k].seen;
    b.held_error = static_cast<float>(batch.max_error);
    b.orphan = false;
    b.wanted = false;
    b.blocked = coarsened;
    judge(squares_[batch.refs[k].square], b, now_ns_);
  }
}

void BlockQueue::unsendable(const Batch& batch) {
  Block& b = at(batch.refs[0]);
  b.blocked = true;
  b.wanted = false;
  ++counters_.unsendable;
}

void BlockQueue::delivered(const BlockRef& ref) {
  Block& b = at(ref);
  if (b.stamp != ref.stamp || b.state == State::kNever) return;
  b.state = State::kDelivered;
}

void BlockQueue::lost(const BlockRef& ref) {
  Block& b = at(ref);
  if (b.stamp != ref.stamp || b.state != State::kInFlight) return;
  b.state = State::kLost;
  b.blocked = false;
  if (!b.wanted) {
    b.wanted = true;
    ++counters_.offered;
  }
}

BlockQueue::Census BlockQueue::census() const {
  Census c;
  for (const Square& s : squares_) {
    c.squares += s.used ? 1 : 0;
    for (const Block& b : s.blocks) {
      if (!s.used) continue;
      const bool coarse = s.spacing == coarse_ && coarse_ != fine_;
      c.waiting += b.wanted && b.content.seen != 0 && (!coarse || fineIsLate(b, now_ns_)) ? 1 : 0;
      c.in_flight += b.state == State::kInFlight ? 1 : 0;
    }
  }
  return c;
}

std::size_t BlockQueue::memoryBytes() const {
  return squares_.size() * sizeof(Square) + index_.memoryBytes();
}

}  // namespace fathom::telemetry

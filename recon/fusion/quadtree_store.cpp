#include "recon/fusion/quadtree_store.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::fusion {
namespace {

// Height error of a straight line between known nodes, per metre between them: seafloor that is interpolated,
// not seen (slopes change by about a tenth over one spacing; the middle is off by half of that).
constexpr float kInterpolationError = 0.05F;

int localIndex(std::int64_t g) {
  return static_cast<int>(g & (QuadtreeStore::kCells - 1));
}

}  // namespace

QuadtreeStore::QuadtreeStore(const QuadtreeConfig& config)
    : config_(config),
      index_([&] {
        if (!(config.root_size > 0.1 && config.root_size < 1e4))
          throw std::invalid_argument("quadtree: root_size must be between 0.1 and 10000 m");
        if (config.max_level < 0 || config.max_level > 12)
          throw std::invalid_argument("quadtree: max_level must be between 0 and 12");
        if (config.max_tiles < 4 || config.max_tiles > 1 << 24)
          throw std::invalid_argument("quadtree: max_tiles must be between 4 and 2^24");
        if (!(config.min_sigma > 0)) throw std::invalid_argument("quadtree: min_sigma must be positive");
        if (!(config.node_spacing_ratio > 0))
          throw std::invalid_argument("quadtree: node_spacing_ratio must be positive");
        if (!(config.gate > 0)) throw std::invalid_argument("quadtree: gate must be positive");
        // A leaf brings at most max_level inner nodes with it.
        return static_cast<std::size_t>(config.max_tiles) * static_cast<std::size_t>(config.max_level + 1);
      }()),
      leaves_(static_cast<std::size_t>(config.max_tiles)),
      nodes_(static_cast<std::size_t>(config.max_tiles)),
      split_reserve_(std::max(4, config.max_tiles / 8)) {
  clear();
}

void QuadtreeStore::clear() {
  index_.clear();
  first_free_ = kNone;
  for (std::int32_t slot = config_.max_tiles - 1; slot >= 0; --slot) {
    Leaf& free = leaf(slot);
    free = Leaf{};
    free.next_free = first_free_;
    first_free_ = slot;
  }
  used_ = high_water_ = 0;
  coarsened_ = 0;
  ++shape_changes_;
}

std::size_t QuadtreeStore::memoryBytes() const {
  return sizeof(*this) + index_.memoryBytes() + leaves_.size() * sizeof(Leaf) + nodes_.size() * sizeof(Nodes);
}

std::int32_t QuadtreeStore::leafAt(int level, std::int64_t gi, std::int64_t gj) const {
  for (int l = 0; l <= config_.max_level; ++l) {
    // Lattice index at the level of the tile asked for; a finer tile begins at the node itself.
    const std::int64_t i = l <= level ? gi >> (level - l) : gi << (l - level);
    const std::int64_t j = l <= level ? gj >> (level - l) : gj << (l - level);
    const TileKey key{static_cast<std::int32_t>(i >> 4), static_cast<std::int32_t>(j >> 4),
                      static_cast<std::int16_t>(l)};
    const std::int32_t found = index_.find(key);
    if (found == TileIndex::kAbsent) return kNone;
    if (found >= 0) return found;
  }
  return kNone;
}

bool QuadtreeStore::ensure(int level, std::int64_t gi, std::int64_t gj, std::uint32_t now) {
  // Making room may coarsen the very path that is being walked; then it is walked again.
  for (int attempt = 0; attempt < 4; ++attempt) {
    bool walk_again = false;
    for (int l = 0; l <= config_.max_level && !walk_again; ++l) {
      const std::int64_t i = l <= level ? gi >> (level - l) : gi << (l - level);
      const std::int64_t j = l <= level ? gj >> (level - l) : gj << (l - level);
      const TileKey key{static_cast<std::int32_t>(i >> 4), static_cast<std::int32_t>(j >> 4),
                        static_cast<std::int16_t>(l)};
      const std::int32_t found = index_.find(key);
      if (found >= 0) {
        if (l >= level || config_.max_tiles - used_ < split_reserve_) {
          leaf(found).observed = now;
          return true;
        }
        split(found, now);  // then on, into the child
      } else if (found == TileIndex::kAbsent) {
        if (first_free_ == kNone) {
          if (!makeRoom(now)) return false;
          walk_again = true;
        } else if (l < level) {
          index_.set(key, TileIndex::kInner);
          ++shape_changes_;
        } else {
          take(key, now);
          return true;
        }
      }
    }
  }
  return false;
}

std::int32_t QuadtreeStore::take(const TileKey& key, std::uint32_t now) {
  const std::int32_t slot = first_free_;
  Leaf& taken = leaf(slot);
  first_free_ = taken.next_free;
  taken = {key, true, false, kNone, now, now};
  nodes(slot).fill(Node{});
  index_.set(key, slot);
  high_water_ = std::max(high_water_, ++used_);
  ++shape_changes_;
  return slot;
}

void QuadtreeStore::release(std::int32_t slot) {
  Leaf& freed = leaf(slot);
  freed.used = false;
  freed.touched = false;
  freed.next_free = first_free_;
  first_free_ = slot;
  --used_;
}

bool QuadtreeStore::groupIsLeaves(const TileKey& parent, std::uint32_t& observed) const {
  observed = 0;
  for (int c = 0; c < 4; ++c) {
    const std::int32_t found = index_.find(child(parent, c / 2, c % 2));
    if (found == TileIndex::kInner) return false;
    if (found >= 0) observed = std::max(observed, leaf(found).observed);
  }
  return true;
}

// Coarsens the least recently observed groups until a tile is free. A group of one tile frees none but makes
// the next coarser group possible; levels only fall, so this ends.
bool QuadtreeStore::makeRoom(std::uint32_t now) {
  while (first_free_ == kNone) {
    bool found = false;
    TileKey best_parent;
    std::uint32_t best_observed = 0;
    std::uint64_t best_order = 0;
    for (const Leaf& candidate : leaves_) {
      if (!candidate.used || candidate.key.level == 0) continue;
      if (found && candidate.observed > best_observed) continue;  // its group is younger still
      const TileKey parent{candidate.key.north_index >> 1, candidate.key.east_index >> 1,
                           static_cast<std::int16_t>(candidate.key.level - 1)};
      std::uint32_t observed = 0;
      if (!groupIsLeaves(parent, observed)) continue;
      const std::uint64_t order = TileIndex::pack(parent);
      if (found && (observed > best_observed || (observed == best_observed && order >= best_order))) continue;
      found = true;
      best_parent = parent;
      best_observed = observed;
      best_order = order;
    }
    if (!found) return false;
    coarsen(best_parent, now);
  }
  return true;
}

// The parent's nodes are the means of the children's, under a tent as wide as the parent's spacing. Each
// child node shares its information out by the same tent, so the information is kept; roughness below the new
// spacing goes to the scatter.
void QuadtreeStore::coarsen(const TileKey& parent, std::uint32_t now) {
  Nodes& merged = scratch_[0];
  const int child_level = parent.level + 1;
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      const std::int64_t gi = (static_cast<std::int64_t>(parent.north_index) * kCells + i) * 2;
      const std::int64_t gj = (static_cast<std::int64_t>(parent.east_index) * kCells + j) * 2;
      std::array<Node, 9> fine;
      std::array<float, 9> tent{};
      float total = 0, depth = 0, information = 0;
      std::array<float, 3> colour{};
      int count = 0;
      for (int k = 0; k < 9; ++k) {
        const int di = k / 3 - 1, dj = k % 3 - 1;
        const std::int32_t slot = leafAt(child_level, gi + di, gj + dj);
        if (slot == kNone || leaf(slot).key.level != child_level) continue;
        fine[static_cast<std::size_t>(k)] =
            nodes(slot)[static_cast<std::size_t>(localIndex(gi + di) * kCells + localIndex(gj + dj))];
        const Node& node = fine[static_cast<std::size_t>(k)];
        if (!node.seen()) continue;
        const float t = (di == 0 ? 1.0F : 0.5F) * (dj == 0 ? 1.0F : 0.5F);
        tent[static_cast<std::size_t>(k)] = t;
        total += t;
        depth += t * node.depth;
        information += t * node.information;
        for (std::size_t c = 0; c < 3; ++c) colour[c] += t * node.colour[c];
        count = std::max(count, static_cast<int>(node.count));
      }
      Node& out = merged[static_cast<std::size_t>(i * kCells + j)];
      out = Node{};
      if (total <= 0) continue;
      out.depth = depth / total;
      out.information = information;
      out.count = static_cast<std::uint8_t>(count);
      for (std::size_t c = 0; c < 3; ++c) out.colour[c] = static_cast<std::uint16_t>(colour[c] / total);
      for (std::size_t k = 0; k < 9; ++k) {
        if (tent[k] <= 0) continue;
        const float deviation = fine[k].depth - out.depth;
        out.scatter += tent[k] * (fine[k].scatter + fine[k].information * deviation * deviation);
      }
    }
  }
  std::uint32_t observed = 0;
  for (int c = 0; c < 4; ++c) {
    const TileKey key = child(parent, c / 2, c % 2);
    const std::int32_t slot = index_.find(key);
    if (slot < 0) continue;
    observed = std::max(observed, leaf(slot).observed);
    release(slot);
    index_.erase(key);
  }
  const std::int32_t slot = take(parent, now);
  leaf(slot).observed = observed;
  nodes(slot) = merged;
  ++coarsened_;
}

// The children's nodes are interpolated from the parent's, share its information, and count as one mesh only,
// so that the denser data that asked for the split soon outweighs or outvotes them. Children without any seen
// node are not made. Needs three free tiles, which the reserve guarantees.
void QuadtreeStore::split(std::int32_t slot, std::uint32_t now) {
  const TileKey parent = leaf(slot).key;
  const std::uint32_t observed = leaf(slot).observed;
  const float error = kInterpolationError * static_cast<float>(spacing(parent.level));
  std::array<bool, 4> any{};
  for (int c = 0; c < 4; ++c) {
    const TileKey key = child(parent, c / 2, c % 2);
    for (int i = 0; i < kCells; ++i) {
      for (int j = 0; j < kCells; ++j) {
        Node node = sample(key.level, static_cast<std::int64_t>(key.north_index) * kCells + i,
                           static_cast<std::int64_t>(key.east_index) * kCells + j);
        if (node.seen()) {
          const float kept = node.scatter / node.information;
          node.information = 1.0F / (4.0F / node.information + error * error);
          node.scatter = kept * node.information;
          node.count = 1;
          node.disagreements = 0;
          any[static_cast<std::size_t>(c)] = true;
        }
        scratch_[static_cast<std::size_t>(c)][static_cast<std::size_t>(i * kCells + j)] = node;
      }
    }
  }
  release(slot);
  index_.set(parent, TileIndex::kInner);
  for (int c = 0; c < 4; ++c) {
    if (!any[static_cast<std::size_t>(c)]) continue;
    const std::int32_t made = take(child(parent, c / 2, c % 2), now);
    leaf(made).observed = observed;
    nodes(made) = scratch_[static_cast<std::size_t>(c)];
  }
  ++shape_changes_;
}

QuadtreeStore::Node QuadtreeStore::sample(int level, std::int64_t gi, std::int64_t gj) const {
  const std::int32_t slot = leafAt(level, gi, gj);
  if (slot == kNone) return {};
  const int found_level = leaf(slot).key.level;
  if (found_level >= level) {
    const int shift = found_level - level;
    return nodes(slot)[static_cast<std::size_t>(localIndex(gi << shift) * kCells + localIndex(gj << shift))];
  }
  const int shift = level - found_level;
  const std::int64_t mask = (std::int64_t{1} << shift) - 1;
  const float fi = static_cast<float>(gi & mask) / static_cast<float>(mask + 1);
  const float fj = static_cast<float>(gj & mask) / static_cast<float>(mask + 1);
  Node out;
  float variance = 0, scatter = 0;
  std::array<float, 3> colour{};
  int count = 255;
  for (int c = 0; c < 4; ++c) {
    const float w = (c / 2 == 1 ? fi : 1 - fi) * (c % 2 == 1 ? fj : 1 - fj);
    if (w <= 0) continue;
    const Node corner = sample(found_level, (gi >> shift) + c / 2, (gj >> shift) + c % 2);
    if (!corner.seen()) return {};
    out.depth += w * corner.depth;
    variance += w / corner.information;
    scatter += w * corner.scatter / corner.information;
    for (std::size_t k = 0; k < 3; ++k) colour[k] += w * corner.colour[k];
    count = std::min(count, static_cast<int>(corner.count));
  }
  out.information = 1.0F / variance;
  out.scatter = scatter * out.information;
  out.count = static_cast<std::uint8_t>(count);
  for (std::size_t k = 0; k < 3; ++k) out.colour[k] = static_cast<std::uint16_t>(colour[k]);
  return out;
}

}  // namespace fathom::fusion

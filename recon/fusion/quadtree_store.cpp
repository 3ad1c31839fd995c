#include "recon/fusion/quadtree_store.hpp"

#include <algorithm>
#include <stdexcept>

#include "recon/fusion/cell_reading.hpp"

namespace fathom::fusion {
namespace {

constexpr double kMinSpacing = 1.0 / 256;  // finer than the accuracy of any stereo point [m]

const QuadtreeConfig& checked(const QuadtreeConfig& c) {
  int exponent = 0;
  if (!(c.root_size >= 0.25 && c.root_size <= 8192) || std::frexp(c.root_size, &exponent) != 0.5)
    throw std::invalid_argument("quadtree: root_size must be a power of two between 0.25 and 8192 m");
  if (c.max_level < 0 || c.max_level > 12)
    throw std::invalid_argument("quadtree: max_level must be between 0 and 12");
  if (c.root_size / (1 << c.max_level) / QuadtreeStore::kCells < kMinSpacing)
    throw std::invalid_argument("quadtree: the finest spacing must be at least 1/256 m");
  if (c.max_tiles < 4 || c.max_tiles > 1 << 24)
    throw std::invalid_argument("quadtree: max_tiles must be between 4 and 2^24");
  if (c.layers_per_tile < 1 || c.layers_per_tile > 4096)
    throw std::invalid_argument("quadtree: layers_per_tile must be between 1 and 4096");
  if (!(c.min_sigma > 0)) throw std::invalid_argument("quadtree: min_sigma must be positive");
  if (!(c.node_spacing_ratio > 0))
    throw std::invalid_argument("quadtree: node_spacing_ratio must be positive");
  if (!(c.gate > 0)) throw std::invalid_argument("quadtree: gate must be positive");
  return c;
}

// Squares above contiguous tiles are a third of their number; scattered ones need more.
std::size_t indexCapacity(const QuadtreeConfig& c) {
  return 2 * static_cast<std::size_t>(c.max_tiles) + static_cast<std::size_t>(c.max_level) + 1;
}

constexpr int kCellCount = QuadtreeStore::kCells * QuadtreeStore::kCells;

// Cell of an observation in an owner `coarser` levels above it.
int ownerCell(const CellObservation& o, int coarser) {
  const TileKey key = o.tile();
  constexpr int kMask = QuadtreeStore::kCells - 1;
  const std::int64_t gi =
      (std::int64_t{key.north_index} * QuadtreeStore::kCells + o.cell() / QuadtreeStore::kCells);
  const std::int64_t gj =
      (std::int64_t{key.east_index} * QuadtreeStore::kCells + o.cell() % QuadtreeStore::kCells);
  return static_cast<int>(((gi >> coarser) & kMask) * QuadtreeStore::kCells + ((gj >> coarser) & kMask));
}

LayerSums sumsOf(const CellObservation& o, int shift) {
  return LayerSums::of(o.weight, static_cast<std::uint32_t>(o.height - ((o.height >> shift) << shift)),
                       o.colour);
}

}  // namespace

QuadtreeStore::QuadtreeStore(const QuadtreeConfig& config)
    : config_(checked(config)),
      index_(indexCapacity(config)),
      tiles_(static_cast<std::size_t>(config.max_tiles)),
      heads_(static_cast<std::size_t>(config.max_tiles)),
      layers_(static_cast<std::size_t>(config.max_tiles) * static_cast<std::size_t>(config.layers_per_tile)) {
  candidates_.reserve(tiles_.size());
  for (int level = 0; level <= config.max_level; ++level)
    bin_shift_[static_cast<std::size_t>(level)] = binShift(spacing(level));
  clear();
}

void QuadtreeStore::clear() {
  index_.clear();
  free_tile_ = free_layer_ = kNone;
  for (std::size_t k = tiles_.size(); k-- > 0;) {
    tiles_[k] = Tile{};
    tiles_[k].next_free = free_tile_;
    free_tile_ = static_cast<std::int32_t>(k);
  }
  for (std::size_t k = layers_.size(); k-- > 0;) {
    layers_[k] = Layer{};
    layers_[k].next = free_layer_;
    free_layer_ = static_cast<std::int32_t>(k);
  }
  candidates_.clear();
  candidates_left_ = 0;
  counters_ = {};
  ++shape_changes_;
}

std::size_t QuadtreeStore::memoryBytes() const {
  return sizeof(*this) + index_.memoryBytes() + tiles_.capacity() * sizeof(Tile) +
         heads_.capacity() * sizeof(Heads) + layers_.capacity() * sizeof(Layer) +
         candidates_.capacity() * sizeof(Candidate);
}

std::int32_t QuadtreeStore::takeTile(const TileKey& key, std::uint32_t now) {
  const std::int32_t slot = free_tile_;
  free_tile_ = at(slot).next_free;
  at(slot) = Tile{};
  at(slot).key = key;
  at(slot).used = true;
  at(slot).seen = now;
  heads_[static_cast<std::size_t>(slot)].fill(kNone);
  index_.set(key, slot);
  counters_.tiles_high_water = std::max(counters_.tiles_high_water, ++counters_.tiles);
  ++shape_changes_;
  return slot;
}

void QuadtreeStore::releaseTile(std::int32_t slot) {
  index_.drop(at(slot).key);
  at(slot).used = false;
  at(slot).next_free = free_tile_;
  free_tile_ = slot;
  --counters_.tiles;
  ++shape_changes_;
}

std::int32_t QuadtreeStore::takeLayer() {
  const std::int32_t k = free_layer_;
  free_layer_ = layerAt(k).next;
  layerAt(k) = Layer{};
  counters_.layers_high_water = std::max(counters_.layers_high_water, ++counters_.layers);
  return k;
}

void QuadtreeStore::releaseLayer(std::int32_t k) {
  layerAt(k).next = free_layer_;
  free_layer_ = k;
  --counters_.layers;
}

QuadtreeStore::Owner QuadtreeStore::findOwner(const TileKey& key) const {
  for (int level = 0; level <= key.level; ++level) {
    const int up = key.level - level;
    const std::int32_t found =
        index_.find({key.north_index >> up, key.east_index >> up, static_cast<std::int16_t>(level)});
    if (found == TileIndex::kAbsent) break;
    if (found >= 0 && (up == 0 || tile(found).closed)) return {found, up};
  }
  return {};
}

void QuadtreeStore::noteChanged(std::int32_t slot, int cell, std::uint32_t now) {
  Tile& t = at(slot);
  t.changed = now;
  t.sent = false;
  const int i = cell / kCells, j = cell % kCells;
  if (i < kEdgeRows) t.edge[0] = now;
  if (i >= kCells - kEdgeRows) t.edge[1] = now;
  if (j < kEdgeRows) t.edge[2] = now;
  if (j >= kCells - kEdgeRows) t.edge[3] = now;
}

bool QuadtreeStore::addOne(const CellObservation& o, const Owner& owner, std::uint32_t now) {
  const int level = tile(owner.slot).key.level, shift = binShiftOf(level);
  const std::int32_t bin = o.height >> shift;
  const int cell = ownerCell(o, owner.coarser);
  std::int32_t* link = &headAt(owner.slot, cell);
  while (*link != kNone && layerAt(*link).bin < bin) link = &layerAt(*link).next;
  if (*link == kNone || layerAt(*link).bin != bin) {
    if (free_layer_ == kNone) return false;
    const std::int32_t made = takeLayer();
    layerAt(made).bin = bin;
    layerAt(made).next = *link;
    *link = made;
    ++at(owner.slot).layers;
  }
  layerAt(*link).sums += sumsOf(o, shift);
  noteChanged(owner.slot, cell, now);
  at(owner.slot).seen = now;
  const std::int32_t first = headAt(owner.slot, cell);
  if (layerAt(first).next != kNone) {
    const CellReading shown = readCell(*this, level, first);
    if (bin < shown.first_bin || bin > shown.last_bin) ++counters_.outvoted;
  }
  return true;
}

void QuadtreeStore::subtractOne(const CellObservation& o, const Owner& owner, std::uint32_t now) {
  const int shift = binShiftOf(tile(owner.slot).key.level);
  const std::int32_t bin = o.height >> shift;
  const int cell = ownerCell(o, owner.coarser);
  std::int32_t* link = &headAt(owner.slot, cell);
  while (*link != kNone && layerAt(*link).bin < bin) link = &layerAt(*link).next;
  if (*link == kNone || layerAt(*link).bin != bin) {
    ++counters_.missing;
    return;
  }
  const std::int32_t k = *link;
  layerAt(k).sums -= sumsOf(o, shift);
  noteChanged(owner.slot, cell, now);
  if (layerAt(k).sums.count() > 0) return;
  *link = layerAt(k).next;
  releaseLayer(k);
  if (--at(owner.slot).layers == 0) releaseTile(owner.slot);
}

bool QuadtreeStore::add(std::span<const CellObservation> observations, std::uint32_t now) {
  Owner owner;
  std::uint64_t owner_of = ~std::uint64_t{0}, shape = 0;
  for (std::size_t k = 0; k < observations.size(); ++k) {
    const CellObservation& o = observations[k];
    for (;;) {
      if ((o.place >> 8) != owner_of || shape != shape_changes_) {
        owner = findOwner(o.tile());
        if (owner.slot == kNone && hasRoom()) owner = {takeTile(o.tile(), now), 0};
        owner_of = o.place >> 8;
        shape = shape_changes_;
      }
      if (owner.slot != kNone && addOne(o, owner, now)) break;
      if (!makeRoom(now)) {
        subtract(observations.first(k), now);
        return false;
      }
      owner_of = ~std::uint64_t{0};
    }
  }
  refreshRelief();
  return true;
}

void QuadtreeStore::subtract(std::span<const CellObservation> observations, std::uint32_t now) {
  Owner owner;
  std::uint64_t owner_of = ~std::uint64_t{0}, shape = 0;
  for (const CellObservation& o : observations) {
    if ((o.place >> 8) != owner_of || shape != shape_changes_) {
      owner = findOwner(o.tile());
      owner_of = o.place >> 8;
      shape = shape_changes_;
    }
    if (owner.slot == kNone)
      ++counters_.missing;
    else
      subtractOne(o, owner, now);
  }
}

bool QuadtreeStore::canCoarsen(const TileKey& parent) const {
  if (index_.below(parent) == 0) return false;
  for (int c = 0; c < 4; ++c)
    if (index_.below(TileIndex::child(parent, c)) > 0) return false;
  return true;
}

// Adds a child's layer to the parent's cell; the layer itself is used or goes back to the pool.
void QuadtreeStore::mergeInto(Heads& heads, int cell, std::int32_t k, int child_shift, int parent_shift) {
  const std::int32_t bin =
      static_cast<std::int32_t>((std::int64_t{layerAt(k).bin} << child_shift) >> parent_shift);
  const std::int64_t lower =
      (std::int64_t{layerAt(k).bin} << child_shift) - (std::int64_t{bin} << parent_shift);
  layerAt(k).sums.rebase(static_cast<std::uint64_t>(lower));
  layerAt(k).bin = bin;
  std::int32_t* link = &heads[static_cast<std::size_t>(cell)];
  while (*link != kNone && layerAt(*link).bin < bin) link = &layerAt(*link).next;
  if (*link != kNone && layerAt(*link).bin == bin) {
    layerAt(*link).sums += layerAt(k).sums;
    releaseLayer(k);
    return;
  }
  layerAt(k).next = *link;
  *link = k;
}

void QuadtreeStore::coarsen(const TileKey& parent, std::uint32_t now) {
  if (!canCoarsen(parent)) return;
  std::int32_t slot = index_.find(parent);
  if (slot >= 0)
    merged_ = heads_[static_cast<std::size_t>(slot)];
  else
    merged_.fill(kNone);
  const int child_shift = binShiftOf(parent.level + 1), parent_shift = binShiftOf(parent.level);
  std::uint32_t seen = 0;
  bool sent = true;
  for (int c = 0; c < 4; ++c) {
    const std::int32_t child = index_.find(TileIndex::child(parent, c));
    if (child < 0) continue;
    seen = std::max(seen, tile(child).seen);
    sent = sent && tile(child).sent;
    for (int cell = 0; cell < kCellCount; ++cell) {
      const int i = (c / 2 * kCells + cell / kCells) / 2, j = (c % 2 * kCells + cell % kCells) / 2;
      for (std::int32_t k = headAt(child, cell); k != kNone;) {
        const std::int32_t next = layerAt(k).next;
        mergeInto(merged_, i * kCells + j, k, child_shift, parent_shift);
        k = next;
      }
    }
    releaseTile(child);
  }
  if (slot < 0) slot = takeTile(parent, seen);
  heads_[static_cast<std::size_t>(slot)] = merged_;
  Tile& t = at(slot);
  t.closed = true;
  t.sent = sent && (t.sent || t.layers == 0);
  t.seen = std::max(t.seen, seen);
  t.changed = now;
  t.edge.fill(now);
  t.layers = 0;
  for (const std::int32_t head : merged_)
    for (std::int32_t k = head; k != kNone; k = layerAt(k).next) ++t.layers;
  ++counters_.coarsened;
  ++shape_changes_;
}

}  // namespace fathom::fusion

#include "recon/fusion/quadtree_map.hpp"

#include <algorithm>

#include "recon/fusion/quadtree_impl.hpp"

namespace fathom::fusion {
namespace {

// Side of a tile towards its neighbour at (north, east), as numbered in QuadtreeStore::Tile::edge.
bool touches(int side, int north, int east) {
  switch (side) {
    case 0:
      return north > 0;  // the south edge of a neighbour to the north
    case 1:
      return north < 0;
    case 2:
      return east > 0;
    default:
      return east < 0;
  }
}

// Last change at the facing edges of the square and of all squares below it there.
std::uint32_t changedTowards(const QuadtreeStore& store, const TileKey& key, int north, int east) {
  const std::int32_t found = store.index().find(key);
  if (found == TileIndex::kAbsent) return 0;
  std::uint32_t last = 0;
  if (found >= 0) {
    const QuadtreeStore::Tile& tile = store.tile(found);
    last = tile.changed;
    for (int side = 0; side < 4; ++side)
      if (touches(side, north, east)) last = std::min(last, tile.edge[static_cast<std::size_t>(side)]);
  }
  if (store.index().below(key) == 0) return last;
  for (int c = 0; c < 4; ++c) {
    if ((north != 0 && (c / 2 == 0) != (north > 0)) || (east != 0 && (c % 2 == 0) != (east > 0))) continue;
    last = std::max(last, changedTowards(store, TileIndex::child(key, c), north, east));
  }
  return last;
}

}  // namespace

QuadtreeMap::QuadtreeMap(const QuadtreeConfig& config) : impl_(std::make_unique<Impl>(config)) {}
QuadtreeMap::~QuadtreeMap() = default;

std::size_t QuadtreeMap::fuse(const Mesh& mesh) {
  Impl& map = *impl_;
  ++map.now;
  const std::span<const CellObservation> seen = map.seen.collect(mesh);
  map.skipped_triangles += map.seen.skippedTriangles();
  if (!map.store.add(seen, map.now)) {
    ++map.refused;
    return 0;
  }
  map.observations += seen.size();
  return seen.size();
}

std::size_t QuadtreeMap::remove(const Mesh& mesh) {
  Impl& map = *impl_;
  ++map.now;
  const std::span<const CellObservation> seen = map.seen.collect(mesh);
  map.store.subtract(seen, map.now);
  map.removed += seen.size();
  return seen.size();
}

bool QuadtreeMap::coarsen(const TileKey& key) {
  if (!impl_->store.canCoarsen(key)) return false;
  impl_->store.coarsen(key, ++impl_->now);
  return true;
}

void QuadtreeMap::noteVehicle(const Eigen::Vector2d& north_east) {
  impl_->store.noteVehicle(north_east);
}

void QuadtreeMap::noteSent(const TileKey& key) {
  impl_->store.noteSent(key);
}

void QuadtreeMap::clear(std::uint32_t fused) {
  Impl& map = *impl_;
  map.store.clear();
  map.now = fused;
  map.observations = map.removed = map.refused = map.skipped_triangles = 0;
}

std::uint32_t QuadtreeMap::fused() const {
  return impl_->now;
}

std::string QuadtreeMap::canonicalBytes() const {
  const QuadtreeStore& store = impl_->store;
  std::vector<std::pair<std::uint64_t, std::int32_t>> tiles;
  store.index().forEach([&](const TileKey& key, std::int32_t slot) {
    if (slot >= 0) tiles.emplace_back(TileIndex::pack(key), slot);
  });
  std::sort(tiles.begin(), tiles.end());
  std::string bytes;
  const auto put = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (const auto& [key, slot] : tiles) {
    put(key);
    put(store.tile(slot).closed);
    for (int cell = 0; cell < QuadtreeStore::kCells * QuadtreeStore::kCells; ++cell) {
      for (std::int32_t k = store.head(slot, cell); k != QuadtreeStore::kNone; k = store.layer(k).next) {
        put(cell);
        put(store.layer(k).bin);
        put(store.layer(k).sums);
      }
    }
  }
  return bytes;
}

QuadtreeMap::Counters QuadtreeMap::counters() const {
  const Impl& map = *impl_;
  const QuadtreeStore::Counters& store = map.store.counters();
  Counters out;
  out.observations = map.observations;
  out.outvoted = store.outvoted;
  out.removed = map.removed;
  out.missing = store.missing;
  out.coarsened = store.coarsened;
  out.refused = map.refused;
  out.skipped_triangles = map.skipped_triangles;
  out.tiles_used = store.tiles;
  out.tiles_high_water = store.tiles_high_water;
  out.layers_used = store.layers;
  out.layers_high_water = store.layers_high_water;
  out.layers = static_cast<int>(map.store.config().max_tiles) * map.store.config().layers_per_tile;
  out.memory_bytes = sizeof(QuadtreeMap) + sizeof(Impl) - sizeof(QuadtreeStore) + map.store.memoryBytes() +
                     map.seen.memoryBytes() + map.leaves.capacity() * sizeof(Impl::Leaf);
  return out;
}

std::uint32_t QuadtreeMap::Impl::revisionOf(const TileKey& key) const {
  std::uint32_t last = 0;
  for (TileKey up = key; up.level > 0;) {
    up = TileIndex::parent(up);
    const std::int32_t found = store.index().find(up);
    if (found >= 0) last = std::max(last, store.tile(found).changed);
  }
  for (int n = -1; n <= 1; ++n)
    for (int e = -1; e <= 1; ++e)
      last =
          std::max(last, changedTowards(store, {key.north_index + n, key.east_index + e, key.level}, n, e));
  return last;
}

void QuadtreeMap::Impl::leavesBelow(const TileKey& key, bool shows_through, int finest) {
  const std::int32_t found = store.index().find(key);
  shows_through = shows_through || found >= 0;
  if (found == TileIndex::kAbsent || store.index().below(key) == 0 || key.level >= finest) {
    if (found != TileIndex::kAbsent || shows_through) leaves.push_back({TileIndex::pack(key), 0});
    return;
  }
  for (int c = 0; c < 4; ++c) leavesBelow(TileIndex::child(key, c), shows_through, finest);
}

void QuadtreeMap::Impl::findLeaves(int finest) {
  leaves.clear();
  store.index().forEach([&](const TileKey& key, std::int32_t) {
    if (key.level == 0) leavesBelow(key, false, finest);
  });
  for (Leaf& leaf : leaves) leaf.revision = revisionOf(TileIndex::unpack(leaf.key));
  std::sort(leaves.begin(), leaves.end(), [](const Leaf& a, const Leaf& b) { return a.key < b.key; });
}

void QuadtreeMap::forEachLeaf(const std::function<void(const TileKey&, std::uint32_t)>& visit) const {
  forEachLeaf(impl_->store.config().max_level, visit);
}

void QuadtreeMap::forEachLeaf(int finest,
                              const std::function<void(const TileKey&, std::uint32_t)>& visit) const {
  impl_->findLeaves(finest);
  for (const Impl::Leaf& leaf : impl_->leaves) visit(TileIndex::unpack(leaf.key), leaf.revision);
}

}  // namespace fathom::fusion

#include "recon/fusion/quadtree_map.hpp"

#include <algorithm>

#include "recon/fusion/quadtree_impl.hpp"

namespace fathom::fusion {

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

}  // namespace fathom::fusion

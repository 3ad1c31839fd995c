#include <algorithm>

#include "recon/fusion/quadtree_impl.hpp"

namespace fathom::fusion {
namespace {

// Side of a tile that the neighbour at (north, east) of it touches, as numbered in QuadtreeStore::Tile::edge.
bool touches(int side, int north, int east) {
  switch (side) {
    case 0:
      return north > 0;  // the neighbour's south edge, when it lies to the north
    case 1:
      return north < 0;
    case 2:
      return east > 0;
    default:
      return east < 0;
  }
}

// Last change at the facing edges of the square and of all below it that lie there.
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

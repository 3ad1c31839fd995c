#pragma once

#include <vector>

#include "recon/fusion/mesh_observations.hpp"
#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {

// State of a QuadtreeMap: fuse(), remove() and leaves are in quadtree_map.cpp, tiles in quadtree_extract.cpp.
struct QuadtreeMap::Impl {
  struct Leaf {
    std::uint64_t key = 0;  // packed
    std::uint32_t revision = 0;
  };

  explicit Impl(const QuadtreeConfig& config) : store(config), seen(config) {
    // Each square in the index has four children at most.
    leaves.reserve(4 * store.index().capacity());
  }

  void findLeaves(int finest);
  void leavesBelow(const TileKey& key, bool shows_through, int finest);
  // Number of the last change that can have changed a tile.
  [[nodiscard]] std::uint32_t revisionOf(const TileKey& key) const;

  QuadtreeStore store;
  MeshObservations seen;
  std::vector<Leaf> leaves;  // see forEachLeaf()
  std::uint32_t now = 0;     // number of the running fuse() or remove()
  std::uint64_t observations = 0, removed = 0, refused = 0, skipped_triangles = 0;
};

}  // namespace fathom::fusion

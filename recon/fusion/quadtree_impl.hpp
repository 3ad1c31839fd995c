#pragma once

#include <vector>

#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {

// State of a QuadtreeMap: fuse() is in quadtree_map.cpp, what reads it in quadtree_extract.cpp.
struct QuadtreeMap::Impl {
  explicit Impl(const QuadtreeConfig& config) : store(config) {
    touched.reserve(static_cast<std::size_t>(config.max_tiles));
    order.reserve(static_cast<std::size_t>(config.max_tiles));
  }

  // Finest level whose nodes are not closer than the configured ratio of a point spacing [m].
  [[nodiscard]] int levelFor(double point_spacing) const;
  // Whether a triangle of twice this area [m^2] and this longest edge [m] is worth looking for nodes under
  // it.
  [[nodiscard]] bool covers(double area2, double longest_edge) const;
  void makeLeaves(const Mesh& mesh);
  void note(const TileKey& key, const Mesh& mesh, const std::array<std::uint32_t, 3>& triangle);
  std::size_t takeObservations();
  void markChanged(int level, std::int64_t gi, std::int64_t gj);
  // Slots of all leaves in the order of their keys.
  const std::vector<std::int32_t>& leavesInOrder();

  QuadtreeStore store;
  std::vector<std::int32_t> touched;                 // leaves with pending observations
  std::vector<std::int32_t> order;                   // see leavesInOrder()
  std::uint64_t order_of_shape = ~std::uint64_t{0};  // shapeChanges() for which `order` holds
  std::uint32_t now = 0;                             // number of the running fuse()
  std::uint64_t observations = 0, outvoted = 0, refused = 0, skipped_triangles = 0;
};

}  // namespace fathom::fusion

#pragma once

#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::surface {

// Which sides of `tile` a point on the lattice stands on, as bits of TileSide.
[[nodiscard]] std::uint8_t sidesOf(const Eigen::Vector3f& point, const TileGrid& grid, const TileId& tile);

// Joins tiles (children of one parent, or any neighbours) into `into`: vertices at one place become one
// (those that tiles share, and those that an atlas doubled at its charts' seams), and stay `shared` only
// where they lie on a side of `into`.
[[nodiscard]] TileMesh joinTiles(const std::vector<const TileMesh*>& tiles, const TileGrid& grid,
                                 const TileId& into);

struct SimplifyCounts {
  std::uint64_t collapses = 0;
  std::uint64_t pinned = 0;    // vertices kept because the surface is not manifold there
  std::uint64_t closed = 0;    // holes
  std::uint64_t stranded = 0;  // triangles kept as they are for the same reason
};

// Fewer triangles by quadric error (Garland & Heckbert 1997), down to `triangles_per_m2` of the surface's
// area; where the edges of the border, each with its face, would leave less than half of that to the inside,
// the inside has half. Shared vertices and the edges between them stay as they are; no face flips, none
// degenerates; topology is kept, but that small holes are closed: those of three edges that were there, for
// they would grow with the triangles around them; and in the end holes of three or four edges that are
// smaller than the mean triangle. Positions stay on TileGrid's lattice. Normals are new, but for those of
// shared vertices, which light the neighbour too; sigma, views and colours follow. `error` grows by a bound
// of the greatest distance between the old surface and the new, either way. Whatever cannot be reached
// without breaking these rules is left. Where the surface is not manifold it is kept as it is.
[[nodiscard]] TileMesh simplify(const TileMesh& tile, double triangles_per_m2,
                                SimplifyCounts* counts = nullptr);

}  // namespace fathom::surface

#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::surface {

// A triangle soup cut into manifold parts: every edge has one face on either side or is a border, and the
// faces around a vertex are one fan. Elsewhere vertices are doubled and pinned; the parts fit as long as
// pinned vertices do not move.
struct ManifoldParts {
  std::vector<std::uint32_t> original;                  // of a vertex of the parts
  std::vector<std::uint8_t> pinned;                     // the vertex is at a cut of the surface
  std::vector<std::array<std::uint32_t, 3>> triangles;  // in the old order, without those of fewer corners
  std::uint64_t cut_edges = 0, split_vertices = 0, dropped_triangles = 0;
};
[[nodiscard]] ManifoldParts manifoldParts(const std::vector<std::array<std::uint32_t, 3>>& triangles,
                                          std::size_t vertices);

// Key of a vertex position: equal for equal positions, for zeros of both signs too.
[[nodiscard]] inline std::array<std::uint32_t, 3> bitsOf(const Eigen::Vector3f& p) {
  return {std::bit_cast<std::uint32_t>(p.x() + 0.0F), std::bit_cast<std::uint32_t>(p.y() + 0.0F),
          std::bit_cast<std::uint32_t>(p.z() + 0.0F)};
}

// The sides of `tile` that a point on the lattice is on, as bits of TileSide.
[[nodiscard]] std::uint8_t sidesOf(const Eigen::Vector3f& point, const TileGrid& grid, const TileId& tile);

// Joins tiles (children of one parent, or any neighbours) into `into`: vertices at one place (shared by
// tiles, or doubled at the seams of an atlas) become one, which stays `shared` only on a side of `into`.
[[nodiscard]] TileMesh joinTiles(const std::vector<const TileMesh*>& tiles, const TileGrid& grid,
                                 const TileId& into);

struct SimplifyCounts {
  std::uint64_t collapses = 0;
  std::uint64_t pinned = 0;    // vertices kept because the surface is not manifold there
  std::uint64_t closed = 0;    // holes
  std::uint64_t stranded = 0;  // triangles kept as they are for the same reason
};

// Reduces triangles by quadric error (Garland & Heckbert 1997), down to `triangles_per_m2` of the surface's
// area, of which the inside keeps at least half beside the faces of the border. Shared vertices and the edges
// between them stay; no face flips or degenerates. Topology is kept, except that small holes are closed: at
// first holes of three edges (they would grow with the triangles around), at the end holes of three or four
// edges smaller than the mean triangle. Positions are on TileGrid's lattice. Normals are computed again,
// except those of shared vertices, which the neighbour has too; sigma, views and colours are carried over.
// `error` grows by a bound of the greatest distance between the old and the new surface, in both directions.
// Collapses that break these rules are not done, and the surface is kept where it is not manifold.
[[nodiscard]] TileMesh simplify(const TileMesh& tile, double triangles_per_m2,
                                SimplifyCounts* counts = nullptr);

}  // namespace fathom::surface

#pragma once

#include <cstdint>
#include <vector>

#include "recon/fusion/voxel_grid.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct ExtractionRule {
  double voxel = 0.033;      // [m]
  int min_observations = 1;  // of a voxel with data
  bool snap = false;         // vertices on TileGrid's lattice
};

// The zero surface of a grid, in the order of the blocks' positions, with the origin of its parts in
// the grid.
struct ExtractedSurface {
  Mesh mesh;                         // normals, sigma and colours for all vertices
  std::vector<std::uint16_t> views;  // a vertex: meshes that saw it
  std::vector<std::uint32_t> home;   // a vertex: index in `parts` of the block where its voxel edge begins
  std::vector<std::uint8_t> planes;  // a vertex: bit 0 (1): its voxel edge is in that block's low x (y) plane
  struct Part {
    VoxelBlockKey block;
    std::size_t first_triangle = 0;  // of its cells; they end where the next part's begin
  };
  std::vector<Part> parts;  // by key
};

// Marching cubes over all cells with data at all eight corners, or at seven when the surface cuts off the
// corner opposite to the unknown one, which then does not matter. The result is a manifold with border: every
// edge has at most two triangles, the triangles at a vertex are one fan. Where two cells meet along an edge
// only, the vertex there is doubled.
//
// Snapped vertices stay on their voxel edge, at least one step of the lattice from its ends, so that no two
// are equal and no triangle is degenerate. A vertex depends only on the voxels within two of it.
[[nodiscard]] ExtractedSurface extractSurface(const VoxelGrid& grid, const ExtractionRule& rule);

}  // namespace fathom::fusion

#pragma once

#include <cstdint>
#include <vector>

#include "recon/fusion/voxel_grid.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct ExtractionRule {
  double voxel = 0.033;      // [m]
  int min_observations = 1;  // of a voxel that counts as seen
  bool snap = false;         // vertices on TileGrid's lattice
};

// The zero surface of a grid, in the order of the blocks' positions, and where in the grid each part of it
// comes from.
struct ExtractedSurface {
  Mesh mesh;                         // normals, sigma and colours for all vertices
  std::vector<std::uint16_t> views;  // a vertex: meshes that saw it
  std::vector<std::uint32_t> home;  // a vertex: the place in `parts` of the block where its voxel edge begins
  std::vector<std::uint8_t>
      planes;  // a vertex: bit 0 (1): its voxel edge lies in the low x (y) plane of that block
  struct Part {
    BlockKey block;
    std::size_t first_triangle = 0;  // of its cells; they end where the next part's begin
  };
  std::vector<Part> parts;  // by key
};

// Marching cubes over all cells whose eight corners were seen, or seven when the surface cuts off the corner
// opposite to the one unseen: what stands there has no bearing on it. The result is a manifold with border:
// every edge has at most two triangles, the triangles at a vertex are one fan. Where two cells meet along an
// edge only, the vertex there is made twice.
//
// Snapped vertices stay on their voxel edge and off its ends by at least one step of the lattice, so that no
// two are equal and no triangle is degenerate: they stand on different edges of a box. What a vertex is
// depends on the voxels within two of it alone.
[[nodiscard]] ExtractedSurface extractSurface(const VoxelGrid& grid, const ExtractionRule& rule);

}  // namespace fathom::fusion

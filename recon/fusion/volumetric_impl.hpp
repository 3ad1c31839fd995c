#pragma once

#include <limits>

#include "recon/fusion/kernels/fusion_kernels.hpp"
#include "recon/fusion/range_mesh.hpp"
#include "recon/fusion/sight_map.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/fusion/voxel_grid.hpp"

namespace fathom::fusion {

// Blocks that are kept, in plan: [x0, x1) and [y0, y1).
struct BlockLimits {
  std::int32_t x0 = std::numeric_limits<std::int32_t>::min(), y0 = x0;
  std::int32_t x1 = std::numeric_limits<std::int32_t>::max(), y1 = x1;
};

// State of a VolumetricFusion: integrate() is in volumetric_fusion.cpp, extract() and extractTiles() in
// volumetric_tiles.cpp.
struct VolumetricFusion::Impl {
  // Adds one triangle of `range_mesh`; false: it is seen too flat or from behind.
  bool fuse(const std::array<std::uint32_t, 3>& triangle, const Eigen::Vector3d& centre);
  // Makes empty what a mesh was seen through.
  void carve(const Eigen::Vector3d& centre);

  VolumetricConfig config;
  const FusionKernels* kernels = nullptr;
  BlockLimits limits;
  VoxelGrid grid;
  Counters counters;
  RangeMesh range_mesh;  // these two of the mesh at hand
  SightMap sight;
};

}  // namespace fathom::fusion

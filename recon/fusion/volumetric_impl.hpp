#pragma once

#include <limits>

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
  // Makes empty what a mesh was seen through.
  void carve(const SightMap& sight, const Eigen::Vector3d& centre);

  VolumetricConfig config;
  BlockLimits limits;
  VoxelGrid grid;
  Counters counters;
};

}  // namespace fathom::fusion

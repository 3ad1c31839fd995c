#pragma once

#include "recon/fusion/sight_map.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/fusion/voxel_grid.hpp"

namespace fathom::fusion {

// State of a VolumetricFusion: integrate() is in volumetric_fusion.cpp, extract() in volumetric_extract.cpp.
struct VolumetricFusion::Impl {
  // Makes empty what a mesh was seen through.
  void carve(const SightMap& sight, const Eigen::Vector3d& centre);

  VolumetricConfig config;
  VoxelGrid grid;
  Counters counters;
};

}  // namespace fathom::fusion

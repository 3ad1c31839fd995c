#pragma once

#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// The bed of the procedural seafloor, in the frame of `origin_nav`. A ledge moves vertices sideways as well
// as down, so its wall is as finely sampled as the flats and may overhang.
[[nodiscard]] GridSurface makeBed(const TerrainConfig& config, const Eigen::Vector3d& origin_nav);

}  // namespace fathom::sim

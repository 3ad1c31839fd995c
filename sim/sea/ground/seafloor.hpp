#pragma once

#include "sim/sea/ground/surface_scene.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// Fills an empty scene with the procedural seafloor of `config`: the bed (sand, ripples, drop-offs) as one
// displaced grid, then stones, boulders and coral heads as closed meshes on it, and commits it.
void buildSeafloor(const TerrainConfig& config, SurfaceScene& scene);

}  // namespace fathom::sim

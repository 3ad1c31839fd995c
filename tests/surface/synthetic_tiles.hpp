#pragma once

#include <functional>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::test {

// Signed distance [m], negative inside the ground, at a place in nav; NaN where nothing was observed.
using Ground = std::function<double(double north, double east, double depth)>;

// Rolling seafloor at 2 m with noise, as fused stereo leaves it: smooth over about three voxels.
[[nodiscard]] Ground noisyTerrain(double noise, unsigned seed);
// The same with a boulder that overhangs, a free-standing wall 8 cm thick, a hole in the data, an arch and a
// pebble that touches nothing.
[[nodiscard]] Ground difficultTerrain(unsigned seed);

// The surface of `ground` within a leaf tile, between two depths: marching cubes over the cells that the tile
// owns, vertices on the lattice, those on its sides shared.
[[nodiscard]] TileMesh syntheticTile(const Ground& ground, const TileGrid& grid, const TileId& tile,
                                     double top = 0.5, double bottom = 3.0);

}  // namespace fathom::test

#pragma once

#include <cmath>
#include <functional>

#include "recon/geometry/tile_mesh.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::topside::synthetic {

using Depth = std::function<double(double north, double east)>;

// A leaf tile over a height field, triangulated every `step` [m]; border vertices on the tiles' common
// planes, as fusion's tiles have them. Colours: red by north, green by east, in steps of 1 cm.
inline TexturedTile fieldTile(const TileId& id, const TileGrid& grid, double step, const Depth& depth) {
  TexturedTile out;
  TileMesh& tile = out.surface;
  tile.tile = id;
  const auto box = grid.box(id);
  const int n = static_cast<int>(std::lround(grid.edge(0) / step));
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const double north = TileGrid::snap(box[0] + (box[2] - box[0]) * i / n);
      const double east = TileGrid::snap(box[1] + (box[3] - box[1]) * j / n);
      tile.mesh.vertices.emplace_back(north, east, TileGrid::snap(depth(north, east)));
      const auto step_of = [](double v) {
        return static_cast<std::uint8_t>(static_cast<int>(std::floor(v * 100)) & 0xFF);
      };
      tile.mesh.colours.push_back({step_of(north), step_of(east), 7});
      tile.mesh.sigma.push_back(0.004F);
      tile.views.push_back(static_cast<std::uint16_t>(3));
    }
  }
  tile.mesh.triangles = fathom::test::latticeTriangles(n + 1, n + 1);
  return out;
}

}  // namespace fathom::topside::synthetic

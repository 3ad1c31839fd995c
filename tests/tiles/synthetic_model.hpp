#pragma once

#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::topside::synthetic {

// A seafloor of hills on which tiles of any level can be cut without cracks: borders keep the finest level's
// vertices, as simplification does, and inside every level has kCells x kCells squares.
struct SyntheticModel {
  static constexpr int kCells = 16;  // along a tile's edge
  TileGrid grid{0.033, 64};
  int texels = 64;  // along an atlas's edge; 0: colours at vertices

  // Height field [m, down] and colour at a place of nav; smooth, of several scales.
  [[nodiscard]] static double depth(double north, double east);
  [[nodiscard]] static Rgb colour(double north, double east);

  [[nodiscard]] TexturedTile tile(const TileId& id) const;
  // All tiles of `levels` levels below the root tile (levels - 1, 0, 0).
  [[nodiscard]] std::vector<TileId> pyramid(int levels) const;
};

}  // namespace fathom::topside::synthetic

#pragma once

#include "recon/geometry/rgb_image.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom {

// A tile as it is looked at. mesh.texture_coordinates lead into the atlas (t upwards: row = (1 - t) * height,
// texel centres at half steps); vertices at charts' seams stand twice.
struct TexturedTile {
  TileMesh surface;
  RgbImage atlas;    // empty: colour by vertex
  double texel = 0;  // edge of a texel on the surface [m]
};

}  // namespace fathom

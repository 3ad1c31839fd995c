#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/tile_grid.hpp"

namespace fathom {

// Sides of a tile, as bits.
enum TileSide : std::uint8_t { kLowNorth = 1, kHighNorth = 2, kLowEast = 4, kHighEast = 8 };

// The surface within one tile, in nav; vertices on TileGrid's lattice. A vertex on a side's plane is shared
// with the neighbour there: it has the same position to the last bit in both, at every level, so that tiles
// of any levels join without cracks.
struct TileMesh {
  TileId tile;
  Mesh mesh;                         // normals, sigma and colours where they are known
  std::vector<std::uint8_t> shared;  // a vertex: bits of TileSide, 0 inside
  std::vector<std::uint16_t> views;  // a vertex: meshes that saw it; may be empty
  double error = 0;                  // of simplification, against the finest surface: greatest distance [m]
};

// A tile's surface with its texture. mesh.texture_coordinates lead into the atlas (t upwards:
// row = (1 - t) * height, texel centres at half steps); vertices at charts' seams appear twice.
struct TexturedTile {
  TileMesh surface;
  RgbImage atlas;    // empty: colour by vertex
  double texel = 0;  // edge of a texel on the surface [m]
};

}  // namespace fathom

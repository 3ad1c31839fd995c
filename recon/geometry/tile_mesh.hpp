#pragma once

#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom {

// Index of a tile of the model: a square of nav's horizontal plane (x north, y east). Level 0 is the finest;
// a tile of the next level covers TileGrid::kFanOut x kFanOut of them.
struct TileId {
  int level = 0;
  std::int32_t x = 0, y = 0;
  auto operator<=>(const TileId&) const = default;
};

// A rectangle of tiles of one level: x in [x0, x1), y in [y0, y1).
struct TileRange {
  std::int32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool operator==(const TileRange&) const = default;
  [[nodiscard]] bool empty() const { return x0 >= x1 || y0 >= y1; }
  [[nodiscard]] bool contains(const TileId& tile) const {
    return tile.x >= x0 && tile.x < x1 && tile.y >= y0 && tile.y < y1;
  }
};

// The tiles of a model. Leaf tiles are `leaf_voxels` voxels wide and their borders are planes of voxel
// centres, so that cells of the volumetric grid belong to one tile each and neighbours share the vertices on
// their border.
struct TileGrid {
  static constexpr int kFanOut = 4;  // children along one side: texel and polygon sizes grow as much a level
  // All vertices of tiles are on this lattice in nav [m]: a power of two, so that a coordinate less than
  // 8 km is exact in single precision and survives the tiles' quantisation to the last bit.
  static constexpr double kLattice = 1.0 / 2048;

  double voxel = 0.033;  // [m]
  int leaf_voxels = 64;

  [[nodiscard]] double edge(int level) const {  // [m]
    return voxel * leaf_voxels * std::pow(kFanOut, level);
  }
  [[nodiscard]] TileId at(int level, double north, double east) const {
    const double size = edge(level);
    return {level, static_cast<std::int32_t>(std::floor(north / size)),
            static_cast<std::int32_t>(std::floor(east / size))};
  }
  [[nodiscard]] static TileId parent(const TileId& tile) {
    const auto up = [](std::int32_t v) { return v >= 0 ? v / kFanOut : -((-v + kFanOut - 1) / kFanOut); };
    return {tile.level + 1, up(tile.x), up(tile.y)};
  }
  // North and east of the low corner, then of the high one [m].
  [[nodiscard]] std::array<double, 4> box(const TileId& tile) const {
    const double size = edge(tile.level);
    return {tile.x * size, tile.y * size, (tile.x + 1) * size, (tile.y + 1) * size};
  }
  [[nodiscard]] static double snap(double value) { return std::nearbyint(value / kLattice) * kLattice; }
};

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

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "recon/fusion/space_division.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/products/tiles/picture_codec.hpp"
#include "recon/surface/blend.hpp"

namespace fathom::topside {

enum class GpuTexture : std::uint8_t { kNone, kKtx2, kDds };  // BC1 beside the tiles

// How the model is made from the fused surface.
struct ModelSettings {
  bool texture = true;
  double texel = 0;  // finest, edge on the surface [m]; 0: a pixel's, from the dive's middle altitude
  int max_atlas = 4096;
  surface::BlendConfig blend;
  PictureConfig picture;
  GpuTexture gpu_texture = GpuTexture::kNone;
  fusion::DivisionConfig division;
};

// Leaf tiles are about this wide, whatever the voxel.
constexpr double kLeafEdge = 64 * 0.033;  // [m]
// Of the finest level, in squares of a voxel: 1000 /m2 at 33 mm. Each next level has a tenth.
constexpr double kTrianglesPerVoxelSquare = 1000 * 0.033 * 0.033;
constexpr double kFewerEachLevel = 10;

[[nodiscard]] inline TileGrid tileGridOf(double voxel) {
  constexpr int kBlock = 8;  // voxels of the fusion's blocks: a tile holds whole ones
  TileGrid grid;
  grid.voxel = voxel;
  grid.leaf_voxels = kBlock * std::max(1, static_cast<int>(std::lround(kLeafEdge / voxel / kBlock)));
  return grid;
}
[[nodiscard]] inline double trianglesPerSquareMetre(const TileGrid& grid, int level) {
  return kTrianglesPerVoxelSquare / (grid.voxel * grid.voxel) / std::pow(kFewerEachLevel, level);
}

}  // namespace fathom::topside

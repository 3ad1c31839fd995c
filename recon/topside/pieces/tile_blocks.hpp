#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"
#include "recon/topside/config/model_settings.hpp"
#include "recon/topside/work/digest.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// What is known of a tile without opening it.
struct TileRecord {
  TileId tile;
  Eigen::Vector3d low = Eigen::Vector3d::Zero(),
                  high = Eigen::Vector3d::Zero();  // its vertices' box, nav [m]
  double error = 0, texel = 0;                     // [m]
  std::uint64_t vertices = 0, triangles = 0;
  double area = 0;                                                    // [m^2]
  std::uint64_t surface_bytes = 0, picture_bytes = 0, gpu_bytes = 0;  // as stored
};

// A tile as a stage leaves it: the file for looking at it, and what its parent is made from.
struct TileBlocks {
  TileRecord record;
  Bytes glb, gpu_texture;
  Bytes feed;   // tileBytes() of the reduced tile
  Bytes patch;  // of a leaf: its layers
};

// `reduced`: the same by quarterAtlas(), or the tile itself where it has no atlas.
[[nodiscard]] TileBlocks packTile(const TexturedTile& tile, const TexturedTile& reduced, const TileGrid& grid,
                                  const ModelSettings& settings);

// Blocks "glb x_y", "gpu x_y", "feed x_y", "patch x_y" and "tiles", the records of all.
void writeTiles(WorkFileWriter& file, const std::vector<TileBlocks>& tiles);
[[nodiscard]] std::vector<TileRecord> readRecords(const WorkFile& file);  // throws DamagedWork
[[nodiscard]] std::string tileName(const TileId& tile);                   // "x_y"
[[nodiscard]] TexturedTile readFeed(const WorkFile& file, const TileId& tile);

}  // namespace fathom::topside

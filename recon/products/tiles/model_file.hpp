#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "recon/products/tiles/glb.hpp"

namespace fathom::topside {

// A level of the model as one mesh for other tools. Axes: x east, y north, z up, of the dive's origin [m].
// Vertices that tiles share on their borders become one, as do those that charts' seams doubled. One tile is
// in memory at a time, and the border of one row of tiles.

using TileSource = std::function<ReadTile(const TileId&)>;
// Reads folder/L/x_y.glb. Throws InputError.
[[nodiscard]] TileSource glbSource(const std::filesystem::path& folder);
// The tiles of a level that are in a folder of tiles, ascending.
[[nodiscard]] std::vector<TileId> tilesOfLevel(const std::filesystem::path& folder, int level);

// A vertex's colour: the picture's there, else its own, else grey.
[[nodiscard]] Rgb vertexColour(const TexturedTile& tile, std::size_t vertex);

struct ModelCounts {
  std::uint64_t tiles = 0, vertices = 0, triangles = 0;
};

// Little-endian PLY: x y z, nx ny nz, red green blue (from the tile's picture), and sigma and views where the
// first tile has them. `tiles`: of one level, in any order.
ModelCounts writeModelPly(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const std::vector<std::string>& comments = {});

// Wavefront OBJ with NAME.mtl and the pictures as JPEG in NAME_textures/ beside it; colours stand behind the
// vertices of tiles without a picture.
ModelCounts writeModelObj(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const std::vector<std::string>& comments = {});

}  // namespace fathom::topside

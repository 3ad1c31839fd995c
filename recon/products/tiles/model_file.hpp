#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "realtime/base/numbers/hash64.hpp"
#include "recon/geometry/tile_mesh.hpp"
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

// Numbers for the vertices of tiles that come in ascending order (x, then y): one for each place. Keeps the
// border of the row of tiles at hand and of the one before.
class JoinedVertices {
 public:
  struct Numbers {
    std::vector<std::uint64_t> of_vertex;  // a vertex of the tile: its number in the whole model
    std::vector<std::uint32_t> added;      // vertices that are new there, ascending numbers
  };
  [[nodiscard]] Numbers add(const TileMesh& tile);
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  using Place = std::array<float, 3>;
  struct Hash {
    std::size_t operator()(const Place& place) const;
  };
  using Known = std::unordered_map<Place, std::uint64_t, Hash>;

  Known row_, next_row_;  // on borders of this row of tiles; of those, what the next row shares
  Known last_row_;
  std::int32_t x_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace fathom::topside

#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/tile_mesh.hpp"

namespace fathom::topside {

// A tile of the model as a tileset lists it.
struct TileEntry {
  TileId id;
  Eigen::Vector3d low, high;  // box of its vertices, nav [m]
  double error = 0;           // TileMesh::error [m]
  double texel = 0;           // [m]
  bool operator==(const TileEntry&) const = default;
};
[[nodiscard]] TileEntry entryOf(const TexturedTile& tile);

// Where a tile is in the tiles folder: "L/x_y" and the ending.
[[nodiscard]] std::string tilePath(const TileId& id, const std::string& ending = ".glb");
// All such files of an output folder as a shell pattern (OutputFolder).
inline constexpr std::string_view kTileFiles =
    "tiles/+([0-9])/?(-)+([0-9])_?(-)+([0-9]).@(glb|json|ktx2|dds)";

struct TilesetConfig {
  // Geometric error a metre of texel. A viewer with the usual target of 16 px refines a tile before its
  // texels are wider than 2 px on the screen.
  double error_per_texel = 8;
  std::size_t max_tiles = 4000;  // in one file; a larger model is cut into files of three levels each
};

// Writes folder/tileset.json (3D Tiles 1.1; OGC 22-025r4), and folder/L/x_y.json for parts of a large model.
// A tile's children are the tiles of the level below in its square; refinement replaces a tile by them. Its
// geometric error is the greater of its surface's error and what its texels ask for, always more than its
// children's; 0 where it has none. A tile that is missing between others, or above several roots, stands in
// the tree without content. Boxes hold all that is below them. The root's transform puts the dive's
// east-north-up at `origin` (WGS84, height 0 is the water's surface) into EPSG:4978; nothing else bends.
// Without an origin they are in no place of the Earth. Any order of entries gives the same bytes. Throws
// std::invalid_argument for no entries or one twice.
void writeTilesets(const std::filesystem::path& folder, std::vector<TileEntry> entries,
                   const std::optional<Geodetic>& origin, const TilesetConfig& config = {});

// Column by column, from east-north-up at a place on the ellipsoid to Earth-centred Earth-fixed [m].
[[nodiscard]] Eigen::Matrix4d ecefFromEnu(const Geodetic& origin);

}  // namespace fathom::topside

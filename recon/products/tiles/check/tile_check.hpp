#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::topside {

struct TileCheck {
  std::uint64_t tiles = 0, tileset_files = 0, levels = 0, triangles = 0, texels = 0, bytes = 0;
  std::uint64_t edges_between_tiles = 0, cracks_between_tiles = 0;
  std::uint64_t edges_between_levels = 0, cracks_between_levels = 0;
  std::uint64_t open_edges = 0;     // on tiles' sides, where the surface ends
  std::vector<std::string> faults;  // a line each, tiles with cracks too
};

// Checks a model as it is on the disk: the tilesets' structure (readTilesets), that every tile, picture and
// GPU texture named is there, whole and the one that its name says, that boxes hold what is in them, that no
// tile is there unlisted, and that the decoded surfaces join without cracks: neighbours of a level along
// their common plane, and every tile along its sides with its children; fine tiles then fit beside coarse
// ones of any level. `folder` holds tileset.json or tiles/tileset.json. Only borders stay in memory, about 5
// kB a tile. Throws InputError where there is no tileset.
[[nodiscard]] TileCheck checkTiles(const std::filesystem::path& folder);

}  // namespace fathom::topside

#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::topside {

// An edge of a tile's surface in the plane of one of its sides where the tile's surface ends: directed as its
// triangle turns. Places are (along the side, down) in whole steps of TileGrid::kLattice.
struct BorderEdge {
  std::array<std::int32_t, 2> from, to;
  auto operator<=>(const BorderEdge&) const = default;
};

// Low north, high north, low east, high east; each ascending. Vertices that charts' seams doubled count as
// one.
using TileBorders = std::array<std::vector<BorderEdge>, 4>;
[[nodiscard]] TileBorders bordersOf(const TileMesh& tile);

struct BorderMatch {
  std::uint64_t equal = 0;              // edges that both have
  std::uint64_t open = 0;               // that one has where the other has nothing: the surface ends there
  std::uint64_t cracks = 0;             // that one has where the other runs otherwise
  std::array<std::int32_t, 2> place{};  // of the first crack
};

// Two tiles of a level on both sides of a plane: the edges of one, turned round, must be the other's. An edge
// that is not there is a crack where the other tile has an edge of its own along it, within two voxels.
[[nodiscard]] BorderMatch matchNeighbours(const std::vector<BorderEdge>& here,
                                          const std::vector<BorderEdge>& there, double voxel);
// A side of a tile and the same stretch of its children's sides: they must be equal, so that fine tiles fit
// beside coarse ones; whatever differs is a crack.
[[nodiscard]] BorderMatch matchLevels(const std::vector<BorderEdge>& parent,
                                      std::vector<BorderEdge> children);

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

#pragma once

#include <array>
#include <compare>
#include <cstdint>
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

}  // namespace fathom::topside

#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "recon/geometry/tile_grid.hpp"

namespace fathom::fusion {

// What one stereo mesh covers in plan: north and east of its low corner, then of its high one [m]. Empty
// (low > high): none.
struct Footprint {
  std::array<double, 4> box{};
};

struct DivisionConfig {
  int target_meshes = 160;  // wanted in a piece; bounds its memory and time
  // Never more in core and overlap together where tiles allow it. Much less makes dense surveys slow: with
  // two meshes a square metre, pieces of 256 make each mesh 3.2 times over, of 512 1.9 times, of 1024 1.5.
  int max_meshes = 512;
  double overlap = 1.5;  // [m] beyond a piece's tiles in which it takes meshes into account
};

// A part of the model that is made by itself: the leaf tiles of `core`, from the meshes that reach into them
// or into the overlap around them.
struct Piece {
  TileRange core;
  std::vector<std::uint32_t> meshes;  // ascending
};

// Divides the survey into rectangles of leaf tiles by recursive cuts. A cut costs the closures that it
// severs, the transects that it crosses, the meshes that both sides need, and its imbalance (after
// Johnson-Roberson et al. 2010, section on splitting the volume); a survey whose meshes overlap everywhere is
// cut evenly. Every leaf tile that a mesh touches is in exactly one piece; a piece lists every mesh that
// reaches it. `closures`: pairs of meshes that localisation joined, other than neighbours in time. Meshes
// over one spot, which no cut could part, stay together even if they are more than the limit. Footprints that
// are not finite, or beyond 1000 km, belong nowhere. Deterministic. 19,000 meshes take some 30 ms.
[[nodiscard]] std::vector<Piece> divideSpace(
    const std::vector<Footprint>& meshes,
    const std::vector<std::pair<std::uint32_t, std::uint32_t>>& closures, const TileGrid& grid,
    const DivisionConfig& config);

}  // namespace fathom::fusion

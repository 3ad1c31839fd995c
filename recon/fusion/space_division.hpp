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
  int target_meshes = 64;  // wanted in a piece; bounds its memory and time
  int max_meshes = 256;    // never more in core and overlap together where tiles allow it
  double overlap = 1.5;    // [m] beyond a piece's tiles in which it takes meshes into account
};

// A part of the model that is made by itself: the leaf tiles of `core`, from the meshes that reach into them
// or into the overlap around them.
struct Piece {
  TileRange core;
  std::vector<std::uint32_t> meshes;  // ascending
};

// Divides the survey into rectangles of leaf tiles by recursive cuts. A cut costs the closures that it
// severs, the transects that it crosses and its imbalance (Johnson-Roberson et al. 2010, section on splitting
// the volume); a survey whose meshes overlap everywhere is cut evenly. Every leaf tile that a mesh touches is
// in exactly one piece. `closures`: pairs of meshes that localisation joined, other than neighbours in time.
// Deterministic.
[[nodiscard]] std::vector<Piece> divideSpace(
    const std::vector<Footprint>& meshes,
    const std::vector<std::pair<std::uint32_t, std::uint32_t>>& closures, const TileGrid& grid,
    const DivisionConfig& config);

}  // namespace fathom::fusion

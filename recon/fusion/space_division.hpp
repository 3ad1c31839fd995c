#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::fusion {

// Plan box of one stereo mesh: north and east of its low corner, then of its high one [m]. low > high: empty.
struct MeshFootprint {
  std::array<double, 4> box{};
};

struct DivisionConfig {
  int target_meshes = 160;  // wanted in a piece; bounds its memory and time
  // Limit of core and overlap together, where tiles allow it. Small limits make dense surveys slow: with
  // two meshes a square metre, each mesh is fused 3.2 times with pieces of 256, 1.9 times with 512, 1.5
  // with 1024.
  int max_meshes = 512;
  double overlap = 1.5;  // around a piece's tiles, from which it takes meshes too [m]
};

// A part of the model that is built separately: the leaf tiles of `core`, from the meshes that reach into
// them or into the overlap around them.
struct Piece {
  TileRange core;
  std::vector<std::uint32_t> meshes;  // ascending
};

// Divides the survey into rectangles of leaf tiles by recursive cuts. The cost of a cut sums the closures
// that it severs, the transects that it crosses, the meshes that both sides need, and its imbalance (after
// Johnson-Roberson et al. 2010, section on splitting the volume). Every leaf tile that a mesh touches is in
// exactly one piece; a piece lists every mesh that reaches it. `closures`: pairs of meshes that localisation
// joined, except neighbours in time. Meshes over one place, which no cut separates, stay together even beyond
// the limit. Footprints that are not finite or beyond 1000 km are ignored. Deterministic. 19,000 meshes take
// some 30 ms.
[[nodiscard]] std::vector<Piece> divideSpace(
    const std::vector<MeshFootprint>& meshes,
    const std::vector<std::pair<std::uint32_t, std::uint32_t>>& closures, const TileGrid& grid,
    const DivisionConfig& config);

}  // namespace fathom::fusion

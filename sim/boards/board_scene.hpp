#pragma once

#include <filesystem>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/terrain_config.hpp"

namespace fathom::sim {

// A chessboard that hangs in open water: a plane with the board's squares as texture and a white margin one
// square wide, nothing behind it. Writes board.ply and board.png into `folder` and gives the terrain that
// reads them. Edges of squares lie on edges of texels at every level of the texture, so that the renderer's
// filter (about one pixel) smooths them without moving them.
[[nodiscard]] TerrainConfig makeBoardTerrain(const calibration::Chessboard& board,
                                             const std::filesystem::path& folder);

// Pose of the board (first inner corner, x along the rows, z away from its printed side) in that terrain's
// nav frame.
[[nodiscard]] SE3 boardInTerrain(const calibration::Chessboard& board);

}  // namespace fathom::sim

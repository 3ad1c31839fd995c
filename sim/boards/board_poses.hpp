#pragma once

#include <cstdint>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::sim {

struct BoardPoseConfig {
  int views = 20;
  double distance = 2.0;   // middle of the board to the camera [m]; from 3/4 to 5/4 of it
  double max_tilt = 0.70;  // of the board against the image plane [rad]
  double max_roll = 0.52;  // about the line of sight [rad]
  std::uint64_t seed = 1;
};

// Poses T_left_board as a diver would hold a board: tilted this way and that, nearer and farther, into every
// part of the image, wholly inside both images. Throws InputError when the board does not fit into them.
[[nodiscard]] std::vector<SE3> boardPoses(const StereoRig& rig, const calibration::Chessboard& board,
                                          const BoardPoseConfig& config);

}  // namespace fathom::sim

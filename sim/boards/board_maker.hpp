#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

struct BoardPoseConfig {
  int views = 20;
  static constexpr double kNearest = 0.75, kFarthest = 1.25;  // bounds of the drawn distance, over `distance`
  double distance = 2.0;   // mean, from the middle of the board to the camera [m]
  double max_tilt = 0.70;  // of the board against the image plane [rad]
  double max_roll = 0.52;  // about the line of sight [rad]
  std::uint64_t seed = 1;
};

// Random poses T_left_board with varied tilt, distance and position in the image, the board completely inside
// both images. Throws InputError for a board that does not fit into them.
[[nodiscard]] std::vector<SE3> boardPoses(const StereoRig& rig, const calibration::Chessboard& board,
                                          const BoardPoseConfig& config);

struct BoardMakerOptions {
  calibration::Chessboard board{9, 6, 0.08};
  BoardPoseConfig poses;
  std::filesystem::path out;
  int threads = 0;  // 0: as many as the machine has
  std::function<void(std::size_t done, std::size_t total)> progress;
};

// Renders a chessboard in the scenario's water with its rig (at its scale), strobes and sensors, exposed for
// white print at the nearest distance. Writes atomically:
//   img/PR_..._LC16.tif, ..._RM16.tif   one pair a second from the scenario's start
//   truth/stereo.calib                  the rig
//   truth/poses.csv                     view,left_image,right_image,x_m,y_m,z_m,qw,qx,qy,qz: T_left_board
//   truth/corners.csv                   view,corner,u_left,v_left,u_right,v_right,x_m,y_m,z_m (left camera)
// The bytes depend on scenario and options only. Throws InputError for a folder that holds anything else, and
// for a board that does not fit.
void makeBoards(const Scenario& scenario, const BoardMakerOptions& options);

}  // namespace fathom::sim

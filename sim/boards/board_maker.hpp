#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>

#include "sim/boards/board_poses.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

struct BoardMakerOptions {
  calibration::Chessboard board{9, 6, 0.08};
  BoardPoseConfig poses;
  std::filesystem::path out;
  int threads = 0;  // 0: as many as the machine has
  std::function<void(std::size_t done, std::size_t total)> progress;
};

// Photographs a chessboard in the scenario's water with its rig (at its scale), strobes and sensors; exposed
// for white print at the nearest distance. Writes, whole or not at all:
//   img/PR_..._LC16.tif, ..._RM16.tif   one pair a second from the scenario's start
//   truth/stereo.calib                  the rig
//   truth/poses.csv                     view,left_image,right_image,x_m,y_m,z_m,qw,qx,qy,qz: T_left_board
//   truth/corners.csv                   view,corner,u_left,v_left,u_right,v_right,x_m,y_m,z_m: left camera
//   frame
// The bytes depend on scenario and options only. Throws InputError for a folder that holds anything else, and
// for a board that does not fit.
void makeBoards(const Scenario& scenario, const BoardMakerOptions& options);

}  // namespace fathom::sim

#pragma once

#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// One board triangulated through a rig and compared with its known shape.
struct BoardError {
  std::string name;
  SE3 T_left_board;                     // the board, of its known size, moved rigidly onto the corners
  std::vector<Eigen::Vector3d> errors;  // triangulated less board, in the left camera frame [m]
  double rms = 0;                       // length of the error [m]
  double max_z = 0;                     // largest |z| [m]
  double scale = 1;                     // of the triangulated board against the true one
  double range = 0;                     // mean z [m]
};

struct BoardCheck {
  std::vector<BoardError> boards;
  std::vector<std::string> failed;                       // views with a corner that does not triangulate
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();        // of all errors [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of all errors about their mean [m^2]
  double max_z = 0;                                      // [m]
  double scale = 1;                                      // median over the boards
  double rms = 0;                                        // [m]
};

// Midpoint triangulation of every corner, then the rigid motion (no scale) that takes the board onto them
// with the least squares (Umeyama 1991). After Johnson-Roberson et al. 2010, figure 7. `views`: corners of
// left and right counted alike (alignBoards).
[[nodiscard]] BoardCheck checkBoards(const StereoRig& rig, const Chessboard& board,
                                     const std::vector<BoardView>& views);

}  // namespace fathom::calibration

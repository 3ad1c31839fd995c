#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// A flat chessboard, by its inner corners (where four squares meet).
struct Chessboard {
  int columns = 9, rows = 6;  // inner corners
  double square = 0.024;      // edge of a square [m]

  [[nodiscard]] std::size_t corners() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

// Inner corners in one image, row by row [px].
using Corners = std::vector<Eigen::Vector2d>;

// The inner corners in the board's frame: x along a row, y along a column, z = 0 [m].
[[nodiscard]] std::vector<Eigen::Vector3d> boardPoints(const Chessboard& board);
// The middle of these.
[[nodiscard]] Eigen::Vector3d boardMiddle(const Chessboard& board);

// Finds every inner corner to a fraction of a pixel; std::nullopt when a part of the board is not visible.
// Mono, RGB or Bayer (its green pixels, the others interpolated), 8 to 16 bits. Which corner comes first may
// differ by the board's symmetry from image to image (see alignBoards()).
[[nodiscard]] std::optional<Corners> findChessboard(const ImageView& image, const Chessboard& board);

// One board in both images of the same moment.
struct BoardView {
  std::string name;
  Corners left, right;
};

// A pair that is not used, and the reason.
struct DroppedView {
  std::string name, reason;
};

// Resolves the order of corners: a chessboard turned by half a turn (a square one also by quarter turns)
// shows the same corners, so that left and right may count them from opposite ends. The rig is rigid: the
// relative pose of the cameras is the same in every view. Finds the relative rotation on which most views
// agree, in any order of their corners, and reorders each view's right corners to it; of two with as many
// views the smaller rotation is taken. Returns for each view whether it agrees (one that does not was not
// taken at the same moment, or its corners are wrong). `left`, `right`: intrinsics, to a few per cent.
[[nodiscard]] std::vector<bool> alignBoards(const Camera& left, const Camera& right, const Chessboard& board,
                                            std::vector<BoardView>& views);

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

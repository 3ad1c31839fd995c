#include "sim/boards/board_poses.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>

#include "realtime/kernel/input_error.hpp"
#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

// The outer squares must be seen too, or no board is found.
bool inside(const StereoRig& rig, const calibration::Chessboard& board, const SE3& T_left_board) {
  constexpr double kMargin = 3;    // [px]
  constexpr double kWidest = 1.2;  // tangent off the axis; beyond, distortion may fold back into the image
  for (const int x : {-1, board.columns})
    for (const int y : {-1, board.rows}) {
      const Eigen::Vector3d in_left = T_left_board * Eigen::Vector3d(x * board.square, y * board.square, 0);
      const Eigen::Vector3d in_right = rig.T_right_left * in_left;
      if (in_left.z() <= 0 || in_right.z() <= 0 || in_left.head<2>().norm() > kWidest * in_left.z() ||
          in_right.head<2>().norm() > kWidest * in_right.z() ||
          !rig.left.contains(rig.left.project(in_left), kMargin) ||
          !rig.right.contains(rig.right.project(in_right), kMargin))
        return false;
    }
  return true;
}

SE3 draw(Random& random, const StereoRig& rig, const calibration::Chessboard& board,
         const BoardPoseConfig& config) {
  constexpr double kNearest = 0.75, kFarthest = 1.25;  // of the distance
  const double z = config.distance * random.uniform(kNearest, kFarthest);
  const Eigen::Vector2d pixel(random.uniform(0, rig.left.width), random.uniform(0, rig.left.height));
  const double heading = random.uniform(0, 2 * std::numbers::pi), tilt = random.uniform(0, config.max_tilt);
  const Eigen::AngleAxisd lean(tilt, Eigen::Vector3d(std::cos(heading), std::sin(heading), 0));
  const Eigen::AngleAxisd roll(random.uniform(-config.max_roll, config.max_roll), Eigen::Vector3d::UnitZ());
  const Eigen::Quaterniond rotation = lean * roll;
  const Eigen::Vector3d middle(0.5 * (board.columns - 1) * board.square,
                               0.5 * (board.rows - 1) * board.square, 0);
  return {rotation, z * rig.left.ray(pixel) - rotation * middle};
}

}  // namespace

std::vector<SE3> boardPoses(const StereoRig& rig, const calibration::Chessboard& board,
                            const BoardPoseConfig& config) {
  Random random(config.seed, "board-poses");
  const Eigen::Vector3d middle(0.5 * (board.columns - 1) * board.square,
                               0.5 * (board.rows - 1) * board.square, 0);
  std::vector<SE3> poses;
  for (int view = 0; view < config.views; ++view) {
    // Nine aims in turn: the middle, the edges' middles, the corners of the image.
    const Eigen::Vector2d aim(0.5 * (view % 3) * rig.left.width, 0.5 * (view / 3 % 3) * rig.left.height);
    constexpr int kGood = 12, kTries = 20000;  // fitting poses to choose the nearest to the aim from
    double nearest = std::numeric_limits<double>::infinity();
    SE3 best;
    int good = 0;
    for (int t = 0; t < kTries && good < kGood; ++t) {
      const SE3 pose = draw(random, rig, board, config);
      if (!inside(rig, board, pose)) continue;
      ++good;
      const double off = (rig.left.project(pose * middle) - aim).norm();
      if (off < nearest) nearest = off, best = pose;
    }
    if (good == 0)
      throw InputError(
          "--board", "",
          "does not fit into both images at this distance; take smaller squares or go farther away");
    poses.push_back(best);
  }
  return poses;
}

}  // namespace fathom::sim

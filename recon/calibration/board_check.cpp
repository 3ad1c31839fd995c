#include "recon/calibration/board_check.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::calibration {
namespace {

bool checkBoard(const StereoRig& rig, const Eigen::Matrix3Xd& board, const BoardView& view, BoardError& out) {
  Eigen::Matrix3Xd points(3, board.cols());
  for (Eigen::Index k = 0; k < board.cols(); ++k) {
    const auto at = static_cast<std::size_t>(k);
    Eigen::Vector3d point;
    double gap = 0;
    if (!triangulatePixels(rig, view.left[at], view.right[at], point, gap) || !point.allFinite())
      return false;
    points.col(k) = point;
  }
  const Eigen::Matrix4d rigid = rigidAlignment(board, points);
  const Eigen::Matrix4d similar = rigidAlignment(board, points, true);
  out.name = view.name;
  out.T_left_board = SE3(Eigen::Matrix3d(rigid.topLeftCorner<3, 3>()), rigid.topRightCorner<3, 1>());
  out.scale = similar.col(0).head<3>().norm();
  out.range = points.row(2).mean();
  double sum = 0;
  for (Eigen::Index k = 0; k < board.cols(); ++k) {
    const Eigen::Vector3d error = points.col(k) - out.T_left_board * Eigen::Vector3d(board.col(k));
    out.errors.push_back(error);
    out.max_z = std::max(out.max_z, std::abs(error.z()));
    sum += error.squaredNorm();
  }
  out.rms = std::sqrt(sum / static_cast<double>(board.cols()));
  return true;
}

}  // namespace

BoardCheck checkBoards(const StereoRig& rig, const Chessboard& board, const std::vector<BoardView>& views) {
  const std::vector<Eigen::Vector3d> points = boardPoints(board);
  Eigen::Matrix3Xd shape(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t k = 0; k < points.size(); ++k) shape.col(static_cast<Eigen::Index>(k)) = points[k];

  BoardCheck out;
  std::vector<double> scales;
  double count = 0, squares = 0;
  Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
  for (const BoardView& view : views) {
    BoardError one;
    if (!checkBoard(rig, shape, view, one)) {
      out.failed.push_back(view.name);
      continue;
    }
    for (const Eigen::Vector3d& e : one.errors) {
      out.mean += e;
      products += e * e.transpose();
      squares += e.squaredNorm();
      count += 1;
    }
    out.max_z = std::max(out.max_z, one.max_z);
    scales.push_back(one.scale);
    out.boards.push_back(std::move(one));
  }
  if (count == 0) return out;
  out.mean /= count;
  out.covariance = products / count - out.mean * out.mean.transpose();
  out.rms = std::sqrt(squares / count);
  out.scale = median(std::move(scales));
  return out;
}

}  // namespace fathom::calibration

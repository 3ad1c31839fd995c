#include "recon/calibration/board_pairing.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "recon/calibration/opencv_bridge.hpp"

namespace fathom::calibration {
namespace {

// Relative rotations of two views differ by this much at most: a view's own rotation is good to about a
// degree (a small board far away).
constexpr double kAgreement = 0.1;  // [rad]

// The corners counted from the other ends: by half a turn, and for a square board by quarter turns.
std::vector<Corners> symmetries(const Corners& corners, const Chessboard& board) {
  std::vector<Corners> out{corners, {corners.rbegin(), corners.rend()}};
  if (board.columns == board.rows) {
    Corners quarter;
    for (int y = 0; y < board.rows; ++y)
      for (int x = 0; x < board.columns; ++x)
        quarter.push_back(corners[static_cast<std::size_t>((board.rows - 1 - x) * board.columns + y)]);
    out.push_back(quarter);
    out.emplace_back(quarter.rbegin(), quarter.rend());
  }
  return out;
}

std::optional<Eigen::Quaterniond> rotationOf(const Camera& camera, const std::vector<cv::Point3f>& board,
                                             const Corners& corners) {
  cv::Mat rotation, translation, matrix;
  if (!cv::solvePnP(board, toCv(corners), matrixOf(camera), distortionOf(camera), rotation, translation,
                    false, cv::SOLVEPNP_IPPE))
    return std::nullopt;
  cv::solvePnPRefineLM(board, toCv(corners), matrixOf(camera), distortionOf(camera), rotation, translation);
  cv::Rodrigues(rotation, matrix);
  Eigen::Matrix3d r;
  for (int i = 0; i < 9; ++i) r(i / 3, i % 3) = matrix.at<double>(i / 3, i % 3);
  return r.allFinite() ? std::optional(Eigen::Quaterniond(r)) : std::nullopt;
}

}  // namespace

std::vector<bool> alignBoards(const Camera& left, const Camera& right, const Chessboard& board,
                              std::vector<BoardView>& views) {
  const std::vector<cv::Point3f> points = toCv(boardPoints(board));
  struct Candidate {
    Eigen::Quaterniond R_right_left;
    Corners corners;
  };
  std::vector<std::vector<Candidate>> candidates(views.size());
  for (std::size_t v = 0; v < views.size(); ++v) {
    const auto R_left_board = rotationOf(left, points, views[v].left);
    if (!R_left_board) continue;
    for (Corners& corners : symmetries(views[v].right, board))
      if (const auto R_right_board = rotationOf(right, points, corners))
        candidates[v].push_back({*R_right_board * R_left_board->conjugate(), std::move(corners)});
  }
  const auto nearest = [&](std::size_t v, const Eigen::Quaterniond& rotation) -> const Candidate* {
    const Candidate* best = nullptr;
    double least = kAgreement;
    for (const Candidate& c : candidates[v]) {
      const double angle = rotation.angularDistance(c.R_right_left);
      if (angle < least) least = angle, best = &c;
    }
    return best;
  };

  std::size_t most = 0;
  double smallest = std::numeric_limits<double>::infinity();
  Eigen::Quaterniond agreed = Eigen::Quaterniond::Identity();
  for (const auto& of_view : candidates) {
    for (const Candidate& c : of_view) {
      std::size_t count = 0;
      for (std::size_t v = 0; v < views.size(); ++v) count += nearest(v, c.R_right_left) != nullptr ? 1U : 0U;
      const double angle = c.R_right_left.angularDistance(Eigen::Quaterniond::Identity());
      if (count > most || (count == most && angle < smallest))
        most = count, smallest = angle, agreed = c.R_right_left;
    }
  }
  std::vector<bool> agrees(views.size(), false);
  for (std::size_t v = 0; v < views.size(); ++v) {
    const Candidate* best = nearest(v, agreed);
    agrees[v] = best != nullptr;
    if (best != nullptr) views[v].right = best->corners;
  }
  return agrees;
}

}  // namespace fathom::calibration

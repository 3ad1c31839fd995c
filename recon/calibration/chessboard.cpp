#include "recon/calibration/chessboard.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/calibration/opencv_bridge.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::calibration {
namespace {

// Green of a Bayer mosaic (red at the even columns of the even rows): the mean of the four neighbours where
// it is absent. Symmetric, so that no corner moves.
cv::Mat greenOf(const cv::Mat& mosaic) {
  cv::Mat padded, green(mosaic.size(), CV_32F);
  cv::copyMakeBorder(mosaic, padded, 1, 1, 1, 1, cv::BORDER_REFLECT_101);
  for (int y = 0; y < mosaic.rows; ++y) {
    const float* above = padded.ptr<float>(y) + 1;
    const float* here = padded.ptr<float>(y + 1) + 1;
    const float* below = padded.ptr<float>(y + 2) + 1;
    auto* out = green.ptr<float>(y);
    for (int x = 0; x < mosaic.cols; ++x) {
      const bool is_green = ((x ^ y) & 1) != 0;
      out[x] = is_green ? here[x] : 0.25F * (above[x] + below[x] + here[x - 1] + here[x + 1]);
    }
  }
  return green;
}

cv::Mat greyOf(const ImageView& image) {
  const int depth = image.bits == 8 ? CV_8U : CV_16U;
  const int channels = image.format == PixelFormat::kRgb ? 3 : 1;
  const cv::Mat pixels(image.height, image.width, CV_MAKETYPE(depth, channels), const_cast<void*>(image.data),
                       image.stride);
  cv::Mat grey;
  pixels.convertTo(grey, CV_32F);
  if (channels == 3) cv::cvtColor(grey, grey, cv::COLOR_RGB2GRAY);
  if (image.format == PixelFormat::kBayerRggb) grey = greenOf(grey);
  return grey;
}

// To 8 bits for the search: the darkest and the brightest part of the pixels are cut off.
cv::Mat stretched(const cv::Mat& grey) {
  constexpr std::size_t kCutOff = 200;  // one pixel of so many, at either end
  std::vector<float> sorted(grey.begin<float>(), grey.end<float>());
  const auto at = [&](std::size_t rank) { return static_cast<double>(ranked(std::span(sorted), rank)); };
  const double low = at(sorted.size() / kCutOff), high = at(sorted.size() - 1 - sorted.size() / kCutOff);
  const double gain = 255.0 / std::max(high - low, 1.0);
  cv::Mat out;
  grey.convertTo(out, CV_8U, gain, -gain * low);
  return out;
}

// Corners to about a pixel; none when no search finds them all. The smoother image hides noise, the sharper
// one shows small squares; the last search is slower, but bears uneven light.
std::vector<cv::Point2f> searchBoard(const cv::Mat& smooth, const cv::Mat& sharp, cv::Size size) {
  constexpr int kFlags =
      cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_FAST_CHECK;
  std::vector<cv::Point2f> found;
  for (const cv::Mat& image : {smooth, sharp})
    if (cv::findChessboardCorners(stretched(image), size, found, kFlags)) return found;
  if (!cv::findChessboardCornersSB(stretched(smooth), size, found,
                                   cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE))
    found.clear();
  return found;
}

// Distance from corner k to the nearest of its neighbours along row and column [px].
double spacingAt(const std::vector<cv::Point2f>& corners, std::size_t k, const Chessboard& board) {
  double least = INFINITY;
  const auto columns = static_cast<std::size_t>(board.columns);
  const auto to = [&](std::size_t other) { least = std::min(least, cv::norm(corners[k] - corners[other])); };
  if (k % columns > 0) to(k - 1);
  if (k % columns + 1 < columns) to(k + 1);
  if (k >= columns) to(k - columns);
  if (k + columns < corners.size()) to(k + columns);
  return least;
}

// Relative rotations of two views differ by this much at most: the standard deviation of a view's own
// rotation is about a degree (a small board far away).
constexpr double kAgreement = 0.1;  // [rad]

// The corners in every order that the symmetry allows: half a turn, and for a square board quarter turns.
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
  return cv::checkRange(matrix) ? std::optional(toSE3(matrix, translation).rotation()) : std::nullopt;
}

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

std::vector<Eigen::Vector3d> boardPoints(const Chessboard& board) {
  std::vector<Eigen::Vector3d> points;
  for (int y = 0; y < board.rows; ++y)
    for (int x = 0; x < board.columns; ++x) points.emplace_back(x * board.square, y * board.square, 0.0);
  return points;
}

Eigen::Vector3d boardMiddle(const Chessboard& board) {
  return {0.5 * (board.columns - 1) * board.square, 0.5 * (board.rows - 1) * board.square, 0};
}

std::optional<Corners> findChessboard(const ImageView& image, const Chessboard& board) {
  // Smaller, four squares never show a corner (and OpenCV's search would read beyond the image).
  constexpr int kSmallest = 32;  // [px]
  if (image.empty() || image.width < kSmallest || image.height < kSmallest) return std::nullopt;
  // Noise clutters the search with contours, and its gradients pull a corner towards the window's middle.
  // Smoothing leaves a corner where it is: it is symmetric about its point.
  constexpr double kSearchSmoothing = 1.0, kCornerSmoothing = 0.7;  // [px]
  const cv::Mat raw = greyOf(image);
  cv::Mat grey, smooth;
  cv::GaussianBlur(raw, grey, {0, 0}, kCornerSmoothing);
  cv::GaussianBlur(raw, smooth, {0, 0}, kSearchSmoothing);
  const std::vector<cv::Point2f> rough = searchBoard(smooth, grey, {board.columns, board.rows});
  if (rough.empty()) return std::nullopt;
  // The window must not reach the neighbouring corners; a larger one averages more noise.
  constexpr double kWindow = 0.4;                          // half edge, of the spacing
  constexpr int kSmallestWindow = 2, kLargestWindow = 11;  // [px]
  constexpr int kIterations = 60;
  constexpr double kStep = 1e-3;  // [px]
  std::vector<cv::Point2f> found = rough;
  for (std::size_t k = 0; k < found.size(); ++k) {
    const int half =
        std::clamp(static_cast<int>(kWindow * spacingAt(rough, k, board)), kSmallestWindow, kLargestWindow);
    std::vector<cv::Point2f> one{rough[k]};
    cv::cornerSubPix(grey, one, {half, half}, {-1, -1},
                     {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, kIterations, kStep});
    found[k] = one[0];
  }
  Corners corners;
  for (const cv::Point2f& p : found) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y)) return std::nullopt;
    corners.emplace_back(p.x, p.y);
  }
  return corners;
}

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

#include "recon/calibration/rig_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "recon/calibration/opencv_bridge.hpp"

namespace fathom::calibration {
namespace {

using Points2 = std::vector<std::vector<cv::Point2f>>;
using Points3 = std::vector<std::vector<cv::Point3f>>;

const cv::TermCriteria kConverged(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-9);

struct OneCamera {
  Camera camera;
  double rms = 0;
  std::vector<double> view_rms;
};

Points2 cornersOf(const std::vector<BoardView>& views, Corners BoardView::*side) {
  Points2 out;
  for (const BoardView& view : views) out.push_back(toCv(view.*side));
  return out;
}

int flagsOf(const RigCalibrationConfig& config) {
  return config.k3 ? 0 : cv::CALIB_FIX_K3;
}

OneCamera calibrateOne(const Points2& corners, const Chessboard& board, ImageSize size,
                       const RigCalibrationConfig& config) {
  const Points3 points(corners.size(), toCv(boardPoints(board)));
  cv::Mat matrix = cv::Mat::eye(3, 3, CV_64F), distortion = cv::Mat::zeros(1, 5, CV_64F), errors;
  OneCamera out;
  out.rms =
      cv::calibrateCamera(points, corners, {size.width, size.height}, matrix, distortion, cv::noArray(),
                          cv::noArray(), cv::noArray(), cv::noArray(), errors, flagsOf(config), kConverged);
  out.camera = toCamera(matrix, distortion, size.width, size.height);
  for (int v = 0; v < static_cast<int>(errors.total()); ++v) out.view_rms.push_back(errors.at<double>(v));
  return out;
}

// Of the distance between measured and projected corners.
class Rms {
 public:
  void add(const std::vector<Eigen::Vector2d>& residuals) {
    for (const auto& r : residuals) squares_ += r.squaredNorm();
    count_ += static_cast<double>(residuals.size());
  }
  void add(const Rms& other) {
    squares_ += other.squares_;
    count_ += other.count_;
  }
  [[nodiscard]] double value() const { return count_ > 0 ? std::sqrt(squares_ / count_) : 0; }

 private:
  double squares_ = 0, count_ = 0;
};

// Of a view, or of the calibration.
void setRms(auto& of, Rms left, const Rms& right) {
  of.left_rms = left.value();
  of.right_rms = right.value();
  left.add(right);
  of.stereo_rms = left.value();
}

void project(const StereoRig& rig, const std::vector<Eigen::Vector3d>& points, CalibratedView& view) {
  view.left_residuals.clear();
  view.right_residuals.clear();
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Eigen::Vector3d in_left = view.T_left_board * points[k];
    view.left_residuals.push_back(view.left[k] - rig.left.project(in_left));
    view.right_residuals.push_back(view.right[k] - rig.right.project(rig.T_right_left * in_left));
  }
  measure(view);
}

Eigen::VectorXd stacked(const CalibratedView& view) {
  const std::size_t n = view.left_residuals.size();
  Eigen::VectorXd out(static_cast<Eigen::Index>(4 * n));
  for (std::size_t k = 0; k < n; ++k) {
    out.segment<2>(static_cast<Eigen::Index>(4 * k)) = view.left_residuals[k];
    out.segment<2>(static_cast<Eigen::Index>(4 * k + 2)) = view.right_residuals[k];
  }
  return out;
}

class Calibrator {
 public:
  Calibrator(std::vector<BoardView> views, const Chessboard& board, ImageSize left, ImageSize right,
             const RigCalibrationConfig& config, const std::string& source)
      : views_(std::move(views)),
        board_(board),
        left_(left),
        right_(right),
        config_(config),
        source_(source) {}

  RigCalibration run() {
    const OneCamera left = calibrateSide("left", &BoardView::left, left_);
    const OneCamera right = calibrateSide("right", &BoardView::right, right_);
    const std::vector<bool> agrees = alignBoards(left.camera, right.camera, board_, views_);
    for (std::size_t v = views_.size(); v-- > 0;)
      if (!agrees[v]) drop(v, kNotOneMoment);
    while (true) {
      requireViews();
      solveRig();
      const auto gross = grossView(out_.views, config_);
      if (!gross) break;
      drop(gross->index, gross->reason);
    }
    out_.sigma = rigUncertainty(out_.rig, out_.views, board_, config_.k3);
    requireDetermined(out_.rig.left.fx, out_.sigma.left.fx, "left");
    requireDetermined(out_.rig.right.fx, out_.sigma.right.fx, "right");
    return out_;
  }

 private:
  void requireViews() const {
    if (static_cast<int>(views_.size()) >= config_.min_views) return;
    std::string why = std::to_string(views_.size()) + " usable pairs of the board, at least " +
                      std::to_string(config_.min_views) +
                      " are needed; take more, tilted and all over the image";
    if (!out_.dropped.empty())
      why += " (first dropped: " + out_.dropped[0].name + ": " + out_.dropped[0].reason + ")";
    throw InputError(source_, "", why);
  }

  void drop(std::size_t index, std::string reason) {
    out_.dropped.push_back({views_[index].name, std::move(reason)});
    views_.erase(views_.begin() + static_cast<std::ptrdiff_t>(index));
  }

  OneCamera calibrateSide(const char* side, Corners BoardView::*corners, ImageSize size) {
    while (true) {
      requireViews();
      OneCamera one;
      try {
        one = calibrateOne(cornersOf(views_, corners), board_, size, config_);
      } catch (const cv::Exception&) {
        throw InputError(source_, side,
                         "the views do not determine the camera; tilt the board about both its axes");
      }
      const auto gross = grossView(side, one.view_rms, config_);
      if (!gross) return one;
      drop(gross->index, gross->reason);
    }
  }

  void solveRig() {
    const Points2 left = cornersOf(views_, &BoardView::left), right = cornersOf(views_, &BoardView::right);
    const OneCamera one = calibrateOne(left, board_, left_, config_);
    const OneCamera two = calibrateOne(right, board_, right_, config_);
    out_.left_alone_rms = one.rms;
    out_.right_alone_rms = two.rms;
    cv::Mat k1 = matrixOf(one.camera), d1 = distortionOf(one.camera), k2 = matrixOf(two.camera),
            d2 = distortionOf(two.camera), r, t, e, f;
    const Points3 points(views_.size(), toCv(boardPoints(board_)));
    cv::stereoCalibrate(points, left, right, k1, d1, k2, d2, {left_.width, left_.height}, r, t, e, f,
                        cv::CALIB_USE_INTRINSIC_GUESS | flagsOf(config_), kConverged);
    out_.rig = {toCamera(k1, d1, left_.width, left_.height), toCamera(k2, d2, right_.width, right_.height),
                toSE3(r, t)};
    requirePossible(out_.rig.left, "left");
    requirePossible(out_.rig.right, "right");
    out_.views.clear();
    for (const BoardView& view : views_) {
      out_.views.push_back(viewOf(view));
      fitPose(out_.rig, board_, out_.views.back());
    }
    measure(out_);
  }

  void requirePossible(const Camera& c, const char* side) const {
    const double longer = std::max(c.width, c.height);
    constexpr double kShortest = 0.1, kLongest = 100;  // focal length, of the image's longer side
    for (const double f : {c.fx, c.fy})
      if (!(f > kShortest * longer && f < kLongest * longer))
        throw InputError(source_, side,
                         "the views do not determine the camera (focal length " + std::to_string(f) +
                             " px); tilt the board about both its axes");
  }

  void requireDetermined(double focal, double sigma, const char* side) const {
    constexpr double kWorst = 0.02;  // of the focal length; ranges would be no better
    if (!(sigma < kWorst * focal))
      throw InputError(
          source_, side,
          "the views leave the focal length open; tilt the board about both its axes, up to 40 deg");
  }

  std::vector<BoardView> views_;
  Chessboard board_;
  ImageSize left_, right_;
  RigCalibrationConfig config_;
  std::string source_;
  RigCalibration out_;
};

}  // namespace

CalibratedView viewOf(const BoardView& corners) {
  CalibratedView view;
  view.name = corners.name;
  view.left = corners.left;
  view.right = corners.right;
  return view;
}

// Gauss-Newton from the left image's own pose. By hand: six numbers with numerical derivatives through lenses
// and ports take fewer lines than a cost function of Ceres.
void fitPose(const StereoRig& rig, const Chessboard& board, CalibratedView& view) {
  const std::vector<Eigen::Vector3d> points = boardPoints(board);
  cv::Mat rotation, translation, matrix;
  cv::solvePnP(toCv(points), toCv(view.left), matrixOf(rig.left), distortionOf(rig.left), rotation,
               translation, false, cv::SOLVEPNP_IPPE);
  cv::solvePnPRefineLM(toCv(points), toCv(view.left), matrixOf(rig.left), distortionOf(rig.left), rotation,
                       translation);
  cv::Rodrigues(rotation, matrix);
  view.T_left_board = toSE3(matrix, translation);
  constexpr int kIterations = 10;
  constexpr double kStep = 1e-6, kEnough = 1e-10;  // of the twist [m, rad]
  for (int i = 0; i < kIterations; ++i) {
    project(rig, points, view);
    const Eigen::VectorXd residual = stacked(view);
    Eigen::MatrixXd jacobian(residual.size(), 6);
    const SE3 pose = view.T_left_board;
    for (int p = 0; p < 6; ++p) {
      Vector6d twist = Vector6d::Zero();
      twist(p) = kStep;
      view.T_left_board = SE3::exp(twist) * pose;
      project(rig, points, view);
      jacobian.col(p) = (stacked(view) - residual) / kStep;
    }
    const Vector6d step = (jacobian.transpose() * jacobian).ldlt().solve(-jacobian.transpose() * residual);
    view.T_left_board = SE3::exp(step) * pose;
    if (step.norm() < kEnough) break;
  }
  project(rig, points, view);
  view.distance = (view.T_left_board * boardMiddle(board)).z();
}

std::optional<GrossView> grossView(const char* what, const std::vector<double>& rms_px,
                                   const RigCalibrationConfig& config) {
  const auto largest = std::max_element(rms_px.begin(), rms_px.end());
  const double typical = median(rms_px);
  if (!(*largest > std::max(config.gross * typical, config.gross_px))) return std::nullopt;
  return GrossView{static_cast<std::size_t>(largest - rms_px.begin()),
                   formatted("%s RMS %.2f px, the median view's is %.2f px", what, *largest, typical)};
}

std::optional<GrossView> grossView(const std::vector<CalibratedView>& views,
                                   const RigCalibrationConfig& config) {
  std::vector<double> rms_px;
  for (const CalibratedView& view : views) rms_px.push_back(view.stereo_rms);
  return grossView("stereo", rms_px, config);
}

void measure(CalibratedView& view) {
  Rms left, right;
  left.add(view.left_residuals);
  right.add(view.right_residuals);
  setRms(view, left, right);
}

void measure(RigCalibration& calibration) {
  Rms left, right;
  for (const CalibratedView& view : calibration.views) {
    left.add(view.left_residuals);
    right.add(view.right_residuals);
  }
  setRms(calibration, left, right);
}

RigCalibration calibrateRig(std::vector<BoardView> views, const Chessboard& board, ImageSize left,
                            ImageSize right, const RigCalibrationConfig& config, const std::string& source) {
  return Calibrator(std::move(views), board, left, right, config, source).run();
}

}  // namespace fathom::calibration

#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

struct ImageSize {
  int width = 0, height = 0;  // [px]
};

struct RigCalibrationConfig {
  bool k3 = false;        // estimate the third radial coefficient too; else it is zero
  int min_views = 4;      // fewer do not separate focal length from distance [views]
  double gross = 3.0;     // a view is dropped when its RMS is this many times the median view's ...
  double gross_px = 0.3;  // ... and at least this [px]: good corners scatter less
};

// Standard deviations, from the residuals' scatter and the normal equations of all parameters together.
struct CameraSigma {
  double fx = 0, fy = 0, cx = 0, cy = 0;          // [px]
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;  // k3: 0 when it was not estimated
};
// A camera's numbers and their standard deviations, one order for both.
inline constexpr std::array<double Camera::*, 9> kIntrinsics{&Camera::fx, &Camera::fy, &Camera::cx,
                                                             &Camera::cy, &Camera::k1, &Camera::k2,
                                                             &Camera::p1, &Camera::p2, &Camera::k3};
inline constexpr std::array<double CameraSigma::*, 9> kIntrinsicSigmas{
    &CameraSigma::fx, &CameraSigma::fy, &CameraSigma::cx, &CameraSigma::cy, &CameraSigma::k1,
    &CameraSigma::k2, &CameraSigma::p1, &CameraSigma::p2, &CameraSigma::k3};
struct PortSigma {
  Eigen::Vector2d normal = Eigen::Vector2d::Zero();  // of its x and y
  double distance = 0;                               // [m]
};
struct RigSigma {
  CameraSigma left, right;
  PortSigma left_port, right_port;                        // of flat ports, where they were estimated
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();     // of T_right_left about x, y, z [rad]
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  // [m]
  double baseline = 0;                                    // [m]
};

// A view that was used. RMS values are those of the distance between a measured and a projected corner [px],
// as OpenCV and most papers give them.
struct CalibratedView {
  std::string name;
  SE3 T_left_board;                                              // of photographs of a board
  double distance = 0;                                           // of its middle, along the left axis [m]
  Corners left, right;                                           // as measured
  std::vector<Eigen::Vector2d> left_residuals, right_residuals;  // measured less projected [px]
  double left_rms = 0, right_rms = 0, stereo_rms = 0;            // [px]
};

struct RigCalibration {
  StereoRig rig;
  RigSigma sigma;
  double left_alone_rms = 0, right_alone_rms = 0;      // of each camera's own calibration [px]
  double left_rms = 0, right_rms = 0, stereo_rms = 0;  // of the rig, over all views [px]
  std::vector<CalibratedView> views;
  std::vector<DroppedView> dropped;
};

// Intrinsics of each camera, then intrinsics and relative pose together (cv::calibrateCamera,
// cv::stereoCalibrate: Zhang 2000, Levenberg-Marquardt on all corners). Views with gross errors are
// dropped, the worst first, and named. Throws InputError (`source`: file or folder to name) when fewer than
// config.min_views are left or the views do not determine the cameras.
[[nodiscard]] RigCalibration calibrateRig(std::vector<BoardView> views, const Chessboard& board,
                                          ImageSize left, ImageSize right, const RigCalibrationConfig& config,
                                          const std::string& source);

// A view of corners before its pose is fitted.
[[nodiscard]] CalibratedView viewOf(const BoardView& corners);
// Fits the board's pose to both images of a view, and sets distance and residuals.
void fitPose(const StereoRig& rig, const Chessboard& board, CalibratedView& view);

// The view with the largest error, if that is gross, and the reason to drop it in words.
struct GrossView {
  std::size_t index = 0;
  std::string reason;
};
[[nodiscard]] std::optional<GrossView> grossView(const char* what, const std::vector<double>& rms_px,
                                                 const RigCalibrationConfig& config);
// The same of the RMS of both images of each view.
[[nodiscard]] std::optional<GrossView> grossView(const std::vector<CalibratedView>& views,
                                                 const RigCalibrationConfig& config);
// The reason of views that alignBoards() drops.
inline constexpr const char* kNotOneMoment =
    "left and right disagree about where the board is: not taken at the same moment";

// Fills the RMS values from the residuals: of a view, of all views together.
void measure(CalibratedView& view);
void measure(RigCalibration& calibration);

// Fills sigma for a rig and views at their least-squares solution (residuals in `views`).
[[nodiscard]] RigSigma rigUncertainty(const StereoRig& rig, const std::vector<CalibratedView>& views,
                                      const Chessboard& board, bool k3);

}  // namespace fathom::calibration

#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::calibration {

// One number of a rig that boards determine.
struct RigParameter {
  std::function<StereoRig(const StereoRig& rig, double by)> moved;
  double step;  // of central differences
};
// fx fy cx cy k1 k2 p1 p2 and perhaps k3, of the left camera, then of the right one.
[[nodiscard]] std::vector<RigParameter> cameraParameters(bool k3);
// The twist of T_right_left, applied on the left.
[[nodiscard]] std::vector<RigParameter> poseParameters();
// x and y of the normal and the distance, of the left port, then of the right one; both cameras have one.
[[nodiscard]] std::vector<RigParameter> portParameters();

// The least-squares problem of all corners of all views about a rig, the boards' own poses eliminated (Schur
// complement).
struct BoardSystem {
  Eigen::MatrixXd information;  // of the parameters, for corners of 1 px
  Eigen::VectorXd gradient;     // information^-1 gradient is Gauss-Newton's step
  double variance = 0;          // of one coordinate of a corner [px^2]

  [[nodiscard]] Eigen::MatrixXd covariance() const;
};
// `views` with poses and residuals of this rig.
[[nodiscard]] BoardSystem boardSystem(const StereoRig& rig, const std::vector<CalibratedView>& views,
                                      const Chessboard& board, const std::vector<RigParameter>& parameters);

// Standard deviation of one parameter; infinite where it is not determined.
[[nodiscard]] double sigmaAt(const Eigen::MatrixXd& covariance, Eigen::Index parameter);
// Fills translation, rotation and baseline from the covariance of poseParameters() that begins at `first`.
void setPoseSigma(const StereoRig& rig, const Eigen::MatrixXd& covariance, Eigen::Index first,
                  RigSigma& sigma);

}  // namespace fathom::calibration

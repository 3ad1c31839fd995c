#pragma once

#include "recon/geometry/se3.hpp"

namespace fathom {

// Of a pose, for twists (rho, phi):  T exp(x) = exp(adjoint(T) x) T.  A right perturbation x of X is the right
// perturbation adjoint(T^-1) x of X T, and its covariance C there adjoint C adjoint^T (Barfoot, "State
// Estimation for Robotics", 2017, section 7.1.4).
[[nodiscard]] inline Matrix6d adjoint(const SE3& T) {
  const Eigen::Matrix3d R = T.matrix3();
  const Eigen::Vector3d& t = T.translation();
  Eigen::Matrix3d hat;
  hat << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Matrix6d a = Matrix6d::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = R;
  a.topRightCorner<3, 3>() = hat * R;
  return a;
}

// The covariance of X T by that of X.
[[nodiscard]] inline Matrix6d carried(const SE3& T, const Matrix6d& covariance) {
  const Matrix6d a = adjoint(T.inverse());
  return a * covariance * a.transpose();
}

}  // namespace fathom

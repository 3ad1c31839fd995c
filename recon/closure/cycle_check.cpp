#include "recon/closure/cycle_check.hpp"

#include <Eigen/Dense>

namespace fathom::closure {
namespace {

// Covariance of the right perturbation of X in X T, as one of the product: Ad(T^-1).
Matrix6d moved(const SE3& T, const Matrix6d& covariance) {
  const SE3 back = T.inverse();
  const Eigen::Matrix3d R = back.matrix3();
  const Eigen::Vector3d& t = back.translation();
  Eigen::Matrix3d hat;
  hat << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = R;
  adjoint.topRightCorner<3, 3>() = hat * R;
  return adjoint * covariance * adjoint.transpose();
}

}  // namespace

double cycleDistance2(const RelativePrior& a_b, const RelativePrior& b_b2, const RelativePrior& a_a2,
                      const RelativePrior& a2_b2) {
  const SE3 one = a_b.T_a_b * b_b2.T_a_b, other = a_a2.T_a_b * a2_b2.T_a_b;
  const Matrix6d covariance = moved(b_b2.T_a_b, a_b.covariance) + b_b2.covariance +
                              moved(a2_b2.T_a_b, a_a2.covariance) + a2_b2.covariance;
  const Vector6d off = (one.inverse() * other).log();
  return off.dot(covariance.ldlt().solve(off));
}

}  // namespace fathom::closure

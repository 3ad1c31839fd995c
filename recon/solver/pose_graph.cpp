#include "recon/solver/pose_graph.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "recon/geometry/se3.hpp"
#include "recon/geometry/symmetric_eigen.hpp"

namespace fathom::slam {
namespace {

// The representative with w >= 0 of the two that mean the same rotation.
Eigen::Quaterniond positive(const Eigen::Quaterniond& q) {
  return q.w() < 0 ? Eigen::Quaterniond(-q.w(), -q.x(), -q.y(), -q.z()) : q;
}

}  // namespace

Vector6d relativePoseError(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to) {
  const SE3 difference = edge.T_from_to.inverse() * (T_w_from.inverse() * T_w_to);
  Vector6d error;
  error << difference.translation(), positive(difference.rotation()).vec();
  return error;
}

RelativePoseLinear linearize(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to) {
  const SE3 between = T_w_from.inverse() * T_w_to;
  const SE3 difference = edge.T_from_to.inverse() * between;
  const Eigen::Quaterniond q = positive(difference.rotation());
  const Eigen::Matrix3d measured = edge.T_from_to.matrix3().transpose();
  RelativePoseLinear l;
  l.error << difference.translation(), q.vec();
  l.by_to.setZero();
  l.by_to.topLeftCorner<3, 3>() = difference.matrix3();
  l.by_to.bottomRightCorner<3, 3>() = 0.5 * (q.w() * Eigen::Matrix3d::Identity() + crossMatrix(q.vec()));
  l.by_from.setZero();
  l.by_from.topLeftCorner<3, 3>() = -measured;
  l.by_from.topRightCorner<3, 3>() = measured * crossMatrix(between.translation());
  l.by_from.bottomRightCorner<3, 3>() =
      -0.5 * (q.w() * Eigen::Matrix3d::Identity() - crossMatrix(q.vec())) * measured;
  return l;
}

bool isPositive(const Matrix6d& information) {
  constexpr double kRounding = 1e-9;  // of the greatest eigenvalue
  if (information.llt().info() == Eigen::Success) return true;
  const Vector6d values = symmetricEigenvalues(information);
  return values(0) >= -kRounding * std::max(0.0, values(5));
}

Matrix6d nearestPositive(const Matrix6d& information) {
  const SymmetricEigen<6> eigen = symmetricEigen(information);
  return eigen.vectors * eigen.values.cwiseMax(0).asDiagonal() * eigen.vectors.transpose();
}

Matrix6d residualInformation(const Matrix6d& of_perturbation) {
  Matrix6d m = 0.5 * (of_perturbation + of_perturbation.transpose());
  m.bottomRows<3>() *= 2;
  m.rightCols<3>() *= 2;
  return m;
}

double chiSquare(const PoseGraph& graph) {
  double sum = 0;
  for (const RelativePose& edge : graph.edges) {
    const Vector6d e = relativePoseError(edge, graph.poses[static_cast<std::size_t>(edge.from)],
                                         graph.poses[static_cast<std::size_t>(edge.to)]);
    sum += e.dot(edge.information * e);
  }
  return sum;
}

}  // namespace fathom::slam

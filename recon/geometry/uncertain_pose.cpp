#include "recon/geometry/uncertain_pose.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace fathom {
namespace {

// Not inlined, so that it is compiled once for each size.
template <int kRows>
[[gnu::noinline]] SymmetricEigen<kRows> solved(const Eigen::Matrix<double, kRows, kRows>& m, int options) {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, kRows, kRows>>;
  SymmetricEigen<kRows> eigen;
  if constexpr (kRows == 2) {
    // Tridiagonal as it is: scaled to [-1, 1] as Eigen does, the same bits without its Householder steps.
    const double greatest = std::max({std::abs(m(0, 0)), std::abs(m(1, 0)), std::abs(m(1, 1))});
    const double scale = greatest == 0 ? 1 : greatest;
    Solver solver;
    solver.computeFromTridiagonal(m.diagonal() / scale, m.template diagonal<-1>() / scale, options);
    eigen.values = scale * solver.eigenvalues();
    if (options == Eigen::ComputeEigenvectors) eigen.vectors = solver.eigenvectors();
  } else {
    const Solver solver(m, options);
    eigen.values = solver.eigenvalues();
    if (options == Eigen::ComputeEigenvectors) eigen.vectors = solver.eigenvectors();
  }
  return eigen;
}

// A right perturbation x of X is the right perturbation adjoint(T^-1) x of X T.
Matrix6d carried(const SE3& T, const Matrix6d& covariance) {
  const Matrix6d by = adjoint(T.inverse());
  return by * covariance * by.transpose();
}

}  // namespace

template <int kRows>
Eigen::Matrix<double, kRows, 1> symmetricEigenvalues(const Eigen::Matrix<double, kRows, kRows>& m) {
  return solved(m, Eigen::EigenvaluesOnly).values;
}

template <int kRows>
SymmetricEigen<kRows> symmetricEigen(const Eigen::Matrix<double, kRows, kRows>& m) {
  return solved(m, Eigen::ComputeEigenvectors);
}

template Eigen::Vector2d symmetricEigenvalues(const Eigen::Matrix2d&);
template Eigen::Vector3d symmetricEigenvalues(const Eigen::Matrix3d&);
template Eigen::Vector4d symmetricEigenvalues(const Eigen::Matrix4d&);
template Vector6d symmetricEigenvalues(const Matrix6d&);
template SymmetricEigen<2> symmetricEigen(const Eigen::Matrix2d&);
template SymmetricEigen<3> symmetricEigen(const Eigen::Matrix3d&);
template SymmetricEigen<4> symmetricEigen(const Eigen::Matrix4d&);
template SymmetricEigen<6> symmetricEigen(const Matrix6d&);

Vector6d relativeEigenvalues(const Matrix6d& a, const Matrix6d& b) {
  const Eigen::LLT<Matrix6d> root(b);
  Matrix6d whitened = a.selfadjointView<Eigen::Lower>();
  root.matrixL().solveInPlace<Eigen::OnTheLeft>(whitened);
  root.matrixU().solveInPlace<Eigen::OnTheRight>(whitened);
  return symmetricEigenvalues(whitened);
}

SE3 perturbed(const SE3& pose, const Vector6d& step) {
  const Eigen::Vector3d phi = step.tail<3>();
  const double angle = phi.norm();
  const Eigen::Quaterniond turn =
      angle > 0 ? Eigen::Quaterniond(Eigen::AngleAxisd(angle, phi / angle)) : Eigen::Quaterniond::Identity();
  return pose * SE3(turn, step.head<3>());
}

Vector6d perturbation(const SE3& from, const SE3& to) {
  const SE3 difference = from.inverse() * to;
  const Eigen::AngleAxisd turn(difference.rotation());
  Vector6d step;
  step << difference.translation(), wrapAngle(turn.angle()) * turn.axis();
  return step;
}

bool solveStep(const Matrix6d& information, const Vector6d& gradient, Vector6d& step) {
  const Eigen::LDLT<Matrix6d> factor(information);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0)) return false;
  step = factor.solve(gradient);
  return step.allFinite();
}

Matrix6d adjoint(const SE3& T) {
  const Eigen::Matrix3d R = T.matrix3();
  const Eigen::Vector3d& t = T.translation();
  Matrix6d a = Matrix6d::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = R;
  a.topRightCorner<3, 3>() = crossMatrix(t) * R;
  return a;
}

double cycleDistance2(const UncertainPose& a_b, const UncertainPose& b_b2, const UncertainPose& a_a2,
                      const UncertainPose& a2_b2) {
  const SE3 one = a_b.T_a_b * b_b2.T_a_b, other = a_a2.T_a_b * a2_b2.T_a_b;
  const Matrix6d covariance = carried(b_b2.T_a_b, a_b.covariance) + b_b2.covariance +
                              carried(a2_b2.T_a_b, a_a2.covariance) + a2_b2.covariance;
  const Vector6d off = (one.inverse() * other).log();
  return off.dot(covariance.ldlt().solve(off));
}

bool closesTriangle(const UncertainPose& a_c, const UncertainPose& a_b, const UncertainPose& b_c) {
  return cycleDistance2(a_c, {SE3(), Matrix6d::Zero()}, a_b, b_c) < kCycleGate;
}

}  // namespace fathom

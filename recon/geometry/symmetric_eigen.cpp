#include "recon/geometry/symmetric_eigen.hpp"

#include <Eigen/Cholesky>
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

}  // namespace fathom

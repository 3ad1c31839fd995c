#pragma once

#include "recon/geometry/se3.hpp"

namespace fathom {

// Eigenvalues of symmetric matrices of 2, 3, 4 or 6 rows, rising; only the lower triangle is read. Without
// heap. Compiled in one place: an object that has Eigen's solver in it takes seconds more to compile.
template <int kRows>
[[nodiscard]] Eigen::Matrix<double, kRows, 1> symmetricEigenvalues(
    const Eigen::Matrix<double, kRows, kRows>& m);

template <int kRows>
struct SymmetricEigen {
  Eigen::Matrix<double, kRows, 1> values;
  Eigen::Matrix<double, kRows, kRows> vectors;  // of length 1, a column each
};
template <int kRows>
[[nodiscard]] SymmetricEigen<kRows> symmetricEigen(const Eigen::Matrix<double, kRows, kRows>& m);

// Generalised eigenvalues: every l with a x = l b x, rising; `b` positive definite.
[[nodiscard]] Vector6d relativeEigenvalues(const Matrix6d& a, const Matrix6d& b);

}  // namespace fathom

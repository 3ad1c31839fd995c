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

// Right perturbation of a pose: T (R = exp(phi), t = rho) for the vector (rho, phi) [m, rad].
[[nodiscard]] SE3 perturbed(const SE3& pose, const Vector6d& step);

// The vector of the right perturbation that takes `from` to `to`, its inverse.
[[nodiscard]] Vector6d perturbation(const SE3& from, const SE3& to);

// Newton's step from the normal equations of such a vector, information * step = gradient; false where the
// information is not positive.
[[nodiscard]] bool solveStep(const Matrix6d& information, const Vector6d& gradient, Vector6d& step);

// A relative pose with the covariance of its right perturbation.
struct UncertainPose {
  SE3 T_a_b;
  Matrix6d covariance = Matrix6d::Identity();  // [m, rad]
};

// Of a pose, for twists (rho, phi):  T exp(x) = exp(adjoint(T) x) T (Barfoot, "State Estimation for
// Robotics", 2017, section 7.1.4).
[[nodiscard]] Matrix6d adjoint(const SE3& T);

// Squared Mahalanobis distance (6 degrees of freedom) by which two measured poses a - b and a2 - b2 of
// neighbours disagree around the cycle a - b - b2 - a2:
//   e = log((T_a_b T_b_b2)^-1 (T_a_a2 T_a2_b2)),
// against the covariances of both and of the two short sides. Two closures of look-alike but different places
// agree by chance alone.
[[nodiscard]] double cycleDistance2(const UncertainPose& a_b, const UncertainPose& b_b2,
                                    const UncertainPose& a_a2, const UncertainPose& a2_b2);
inline constexpr double kCycleGate = 16.81;  // of it: chi-square with 6 degrees of freedom, 99 %
// Whether a measured pose a - c agrees, within that gate, with the measured chain a - b, b - c.
[[nodiscard]] bool closesTriangle(const UncertainPose& a_c, const UncertainPose& a_b,
                                  const UncertainPose& b_c);

}  // namespace fathom

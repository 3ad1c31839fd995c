#pragma once

#include <Eigen/Dense>
#include <optional>

namespace fathom {

// The rotation nearest to a matrix that a file gives with few decimals (polar decomposition); none where an
// element of R^T R - I is over 1e-3, or R mirrors.
[[nodiscard]] inline std::optional<Eigen::Matrix3d> nearestRotation(const Eigen::Matrix3d& r) {
  constexpr double kTolerance = 1e-3;  // real files carry six decimals
  const double off = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off <= kTolerance) || r.determinant() < 0) return std::nullopt;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

}  // namespace fathom

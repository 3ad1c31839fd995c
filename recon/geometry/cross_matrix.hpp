#pragma once

#include <Eigen/Core>

namespace fathom {

// The matrix of a cross product: crossMatrix(v) u = v x u.
[[nodiscard]] inline Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace fathom

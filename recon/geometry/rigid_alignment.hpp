#pragma once

#include <Eigen/Core>

namespace fathom {

// The rigid motion, as a matrix of homogeneous coordinates, that takes points `from` nearest to their
// counterparts `to`, a column each (Umeyama 1991); `scaled`: with the best scale besides.
[[nodiscard]] Eigen::Matrix4d rigidAlignment(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to,
                                             bool scaled = false);

}  // namespace fathom

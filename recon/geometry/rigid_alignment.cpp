#include "recon/geometry/rigid_alignment.hpp"

#include <Eigen/Geometry>

namespace fathom {

Eigen::Matrix4d rigidAlignment(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to, bool scaled) {
  return Eigen::umeyama(from, to, scaled);
}

}  // namespace fathom

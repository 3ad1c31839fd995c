#include "recon/closure/frame_features.hpp"

namespace fathom::closure {

std::size_t descriptorBytes(DescriptorKind kind) {
  switch (kind) {
    case DescriptorKind::kRootSift:
      return 128;
    case DescriptorKind::kOrb:
      return 32;
    case DescriptorKind::kAkaze:
      return 61;
    case DescriptorKind::kBrisk:
      return 64;
  }
  return 0;
}

Eigen::Matrix3d Feature::covarianceMatrix() const {
  Eigen::Matrix3f c;
  c << covariance[0], covariance[1], covariance[2], covariance[1], covariance[3], covariance[4],
      covariance[2], covariance[4], covariance[5];
  return c.cast<double>();
}

}  // namespace fathom::closure

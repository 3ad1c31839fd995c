#include "recon/closure/given_features.hpp"

#include <Eigen/Dense>

namespace fathom::closure {
namespace {

// False when the rays do not meet where a feature can be.
bool triangulate(const StereoFeature& f, const StereoRig& rig, const GivenFeatureLimits& limits,
                 StereoMatch& match) {
  match.right = f.right.cast<double>();
  const double sigma = static_cast<double>(f.match_sigma);
  match.covariance = sigma * sigma * Eigen::Matrix2d::Identity();
  double gap = 0;
  if (!triangulatePixels(rig, f.left.cast<double>(), match.right, match.point, gap)) return false;
  const double z = match.point.z();
  return z >= limits.depths.nearest && z <= limits.depths.farthest &&
         gap * rig.left.fx / z <= limits.max_epipolar_distance;
}

}  // namespace

FrameFeatures featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig,
                           const GivenFeatureLimits& limits) {
  FrameFeatures features;
  featuresFrom(frame, rig, limits, features);
  return features;
}

void featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig, const GivenFeatureLimits& limits,
                  FrameFeatures& features) {
  features.kind = DescriptorKind::kRootSift;
  features.features.clear();
  features.descriptors.clear();
  if (frame.width != rig.left.width || frame.height != rig.left.height) return;
  const StereoMatcher matcher(rig, {});
  for (const StereoFeature& f : frame.features) {
    if (static_cast<int>(features.size()) >= limits.max_features) break;
    StereoMatch match;
    if (!triangulate(f, rig, limits, match)) continue;
    const Eigen::Matrix3f c =
        matcher.pointCovariance(f.left.cast<double>(), match, static_cast<double>(f.place_sigma))
            .cast<float>();
    if (!(c.determinant() > 0)) continue;
    features.features.push_back({f.left,
                                 f.right,
                                 match.point.cast<float>(),
                                 {c(0, 0), c(0, 1), c(0, 2), c(1, 1), c(1, 2), c(2, 2)},
                                 f.size});
    features.descriptors.insert(features.descriptors.end(), f.descriptor.begin(), f.descriptor.end());
  }
}

}  // namespace fathom::closure

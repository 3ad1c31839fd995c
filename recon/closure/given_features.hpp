#pragma once

#include "recon/closure/frame_features.hpp"
#include "recon/closure/stereo_match.hpp"
#include "recon/geometry/stereo_feature_frame.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

struct GivenFeatureLimits {
  int max_features = 600;  // of a frame; the first, which are the strongest
  DepthRange depths;
  double max_epipolar_distance = 1.0;  // [px]
};

// What FeatureExtractor makes of images, made of features that were matched before: points by the midpoint of
// the rays, covariances from the standard deviations that each feature states (as
// StereoMatcher::pointCovariance). A feature whose rays miss each other by more than max_epipolar_distance,
// or that lies outside the depths, is left out; a frame of another size than the rig's left image gives none.
[[nodiscard]] FrameFeatures featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig,
                                         const GivenFeatureLimits& limits = {});
// The same into features whose memory is used again.
void featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig, const GivenFeatureLimits& limits,
                  FrameFeatures& features);

}  // namespace fathom::closure

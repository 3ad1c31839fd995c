#pragma once

#include <functional>
#include <memory>

#include "recon/closure/frame_features.hpp"
#include "recon/closure/stereo_match.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_feature_frame.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

struct FeatureConfig {
  int max_features = 600;  // of a frame, spread over the image (up to kMaxSlotFeatures)
  int max_width = 400;     // the left image is halved until it is at most so wide before detection [px]
  double place_sigma =
      0.12;  // of a feature's place in the left image from view to view [px of the halved image]
  double place_sigma_per_size = 0.02;  // more of it for large features [px per px of their diameter]
  DepthRange depths;
  StereoMatchConfig stereo;
};

// Root-SIFT features of stereo frames (Arandjelovic 2012): detected and thinned in the left image,
// found in the right one by StereoMatcher, and then described. Describing the right image too would cost as
// much again and lose the features that the detector finds in one image only.
class FeatureExtractor {
 public:
  // Throws std::invalid_argument for a configuration out of range.
  FeatureExtractor(const StereoRig& rig, const FeatureConfig& config);
  ~FeatureExtractor();

  // Takes a corrected rig for later calls; image sizes are the same.
  void setRig(const StereoRig& rig);

  // `left`, `right`: 8-bit mono, lighting corrected, the rig's size. Empty or wrongly sized images, and
  // masked parts, give no features. `depths`: narrows the configured range, where the altitude is known.
  // `ground`: the seafloor's normal in the left camera's axes, away from the camera; in an oblique view
  // features are detected and described in the image rectified to a view from straight above, so that they
  // are the same from all sides. Images that give few are tried once more, smoothed and of more contrast,
  // which takes as long again. The result is reused by the next call.
  const FrameFeatures& process(const ImageView& left, const ImageView& right);
  const FrameFeatures& process(const ImageView& left, const ImageView& right, const DepthRange& depths,
                               const Eigen::Vector3d& ground = Eigen::Vector3d::UnitZ());

  // Called with the stage's name at the end of each stage of process(): "detect", "stereo", "describe", so
  // that a caller with a clock can time them; empty: none.
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct GivenFeatureLimits {
  int max_features = 600;  // of a frame; the first, which are the strongest
  DepthRange depths;
  double max_epipolar_distance = 1.0;  // [px]
};

// The features of a mission that has matched features instead of images: points by the midpoint of the rays,
// covariances from the standard deviations that each feature states (as StereoMatcher::pointCovariance). A
// feature with rays farther apart than max_epipolar_distance, or outside the depths, is left out; a frame of
// another size than the rig's left image gives none.
[[nodiscard]] FrameFeatures featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig,
                                         const GivenFeatureLimits& limits = {});
// The same into features that keep their memory.
void featuresFrom(const StereoFeatureFrame& frame, const StereoRig& rig, const GivenFeatureLimits& limits,
                  FrameFeatures& features);

}  // namespace fathom::closure

#pragma once

#include <functional>
#include <memory>

#include "recon/closure/frame_features.hpp"
#include "recon/closure/stereo_match.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

struct FeatureConfig {
  DescriptorKind kind = DescriptorKind::kRootSift;
  int max_features = 600;     // of a frame, spread over the image (up to kMaxSlotFeatures)
  int max_width = 400;        // features are sought in the left image halved until it is at most so wide [px]
  double place_sigma = 0.12;  // of a feature's place in the left image from view to view [px as sought]
  double place_sigma_per_size = 0.02;  // more of it for large features [px per px of their diameter]
  DepthRange depths;
  StereoMatchConfig stereo;
};

// Features of stereo frames: detected and thinned in the left image by OpenCV, found in the right one by
// StereoMatcher, and then described. Describing the right image too would cost as much again and lose the
// features that the detector finds in one image only.
class FeatureExtractor {
 public:
  // Throws std::invalid_argument for a configuration out of range.
  FeatureExtractor(const StereoRig& rig, const FeatureConfig& config);
  ~FeatureExtractor();

  // As the rig stands from now on; of the same images.
  void setRig(const StereoRig& rig);

  // `left`, `right`: 8-bit mono, lighting corrected, the rig's size. Empty or wrongly sized images, and what
  // their masks hide, give no features. `depths`: narrows the configured range, where the altitude is known.
  // `ground`: the seafloor's normal in the left camera's axes, away from it; where the camera looks at it
  // aslant, features are sought and described in a view from straight above, so that they are the same from
  // all sides. The result is reused by the next call.
  const FrameFeatures& process(const ImageView& left, const ImageView& right);
  const FrameFeatures& process(const ImageView& left, const ImageView& right, const DepthRange& depths,
                               const Eigen::Vector3d& ground = Eigen::Vector3d::UnitZ());

  // Called with the stage's name at the end of each stage of process(): "detect", "stereo", "describe". For a
  // caller that has a clock; empty: none.
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::closure

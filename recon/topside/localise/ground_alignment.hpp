#pragma once

#include "recon/closure/frame_features.hpp"
#include "recon/closure/registration.hpp"
#include "recon/topside/localise/ground_picture.hpp"

namespace fathom::topside {

// What one frame shows of the ground.
struct GroundView {
  cv::Mat mono;  // 8 bits, left image, corrected for light
  GroundPlane plane;
  closure::FrameFeatures features;  // places with their points; descriptors are not used
};

struct GroundAlignment {
  closure::Refusal refusal = closure::Refusal::kNoFeatures;
  UncertainPose pose;  // T_a_b, if there is no refusal
  int tracked = 0, inliers = 0;
  double coverage = 0;     // of the overlap's cells that hold features, those that hold inliers
  double correlation = 0;  // of both pictures of the ground, laid on each other
};

// The relative pose of two frames of a level ground that shows no features worth the name (mud, blurred
// sand), from all of their pixels:
//   pictures of the ground from above ─► turn and shift that correlate best ─► b's image seen from a ─►
//   a's points tracked into it (Lucas-Kanade, forth and back) ─► pose of least squares, by those that agree,
// twice, the second time seen from the pose found; and the same with a and b changed. `camera`: of the mono
// images. Same input, same result.
[[nodiscard]] GroundAlignment alignGround(const Camera& camera, const GroundView& a, const GroundView& b);

}  // namespace fathom::topside

#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "recon/closure/frame_features.hpp"
#include "recon/closure/registration.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

// The seafloor before one camera as a plane; its frame: origin at the foot of the perpendicular from the
// camera, z along the normal away from the camera, x towards the top of the image.
struct GroundPlane {
  Eigen::Vector3d normal;  // camera frame, unit
  double distance = 0;     // [m]

  [[nodiscard]] SE3 T_cam_ground() const;
  // Where a ray from the camera, (x/z, y/z, 1), meets it, camera frame [m]; none beyond `farthest` times the
  // distance.
  [[nodiscard]] std::optional<Eigen::Vector3d> under(const Eigen::Vector3d& ray, double farthest) const;
};

// What a camera sees of the ground, halved until it is `widest` px wide, with mean and contrast made the same
// everywhere (over about a twelfth of the width), which takes out lamps: float, about -3 to 3. `camera`
// becomes the smaller image's.
[[nodiscard]] cv::Mat evenContrast(const cv::Mat& mono, int widest, Camera& camera);

// An image laid out on its ground plane, seen from above.
struct GroundPicture {
  cv::Mat values;          // float, 0 where nothing was seen; columns along y, rows along x of the ground
  cv::Mat seen;            // float, 1 or 0
  double cell = 0;         // [m]
  Eigen::Vector2d corner;  // ground x, y of the first cell [m]
};
// Turned about the ground's z by `turn` [rad]: a point g of the ground is at R(turn) g in the picture.
[[nodiscard]] GroundPicture layOut(const cv::Mat& even, const Camera& camera, const GroundPlane& plane,
                                   double cell, double turn);

// Where one picture is on another: the shift of normalised cross-correlation's peak under both masks
// (Padfield, "Masked Object Registration in the Fourier Domain", 2012), by whole cells.
struct GroundMatch {
  double correlation = 0;                           // at the peak
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // a point of b is at its place plus this in a [m]
};
// Of shifts that leave at least `least_overlap` of the smaller picture's cells in both. Cells must be equal.
[[nodiscard]] GroundMatch correlate(const GroundPicture& a, const GroundPicture& b, double least_overlap);

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
// images; `reckoned`: T_a_b by the vehicle's sensors, to whose turn the search is then confined. Same input,
// same result.
[[nodiscard]] GroundAlignment alignGround(const Camera& camera, const GroundView& a, const GroundView& b,
                                          const std::optional<SE3>& reckoned = std::nullopt);

}  // namespace fathom::topside

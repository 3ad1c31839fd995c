#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// What a stereo rig saw on its way: poses of the left camera, points, and where these were seen.
struct RigBundle {
  struct Pose {
    SE3 T_left_world;
    bool fixed = false;  // one of those that share points
  };
  struct Sighting {
    std::uint32_t pose = 0, point = 0;
    bool right = false;
    Eigen::Vector2d pixel;  // distorted, as seen [px]
    bool used = true;
  };
  StereoRig rig;
  std::vector<Pose> poses;
  std::vector<Eigen::Vector3d> points;  // world [m]
  std::vector<Sighting> sightings;

  // Seen less projected [px]; far away where the point is not in front of the camera.
  [[nodiscard]] Eigen::Vector2d residual(const Sighting& sighting) const;
};

// What is believed of both cameras before anything is seen: standard deviations. Principal point, tangential
// distortion and the rig's turn take each other's place in what a dive shows, so that the first is held near
// the middle, as is usual in structure from motion; what is off there, the others make good.
struct CameraPrior {
  double centre = 5e-4;   // of the principal point, off the image's middle [image widths]
  double aspect = 0.001;  // of ln (fy / fx): chips have square pixels, and ports hardly change them
  double k1 = 0.5, k2 = 0.5;
  double tangential = 0.01;  // p1, p2
};

// For CameraPrior::centre, where a dive has turns, tilt and relief enough to tell it.
inline constexpr double kFreeCentre = 0.01;

struct BundleConfig {
  CameraPrior prior;
  int steps = 50;
  double loss_px = 1.0;  // where Cauchy's loss begins to forget a sighting
};

// The most likely rig, poses and points (Ceres: Levenberg-Marquardt, points eliminated). Both cameras and the
// rig's relative pose move, but for its baseline, which gives the scale, and k3, which stays. Sightings that
// are not used are passed over.
void adjust(RigBundle& bundle, const BundleConfig& config);

// Standard deviations at the solution, from the sightings' scatter and the whole system, priors included.
// False where the system is singular.
[[nodiscard]] bool bundleUncertainty(const RigBundle& bundle, const BundleConfig& config, RigSigma& sigma);

}  // namespace fathom::calibration

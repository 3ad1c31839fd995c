#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// Bundle of a stereo rig along its track: poses of the left camera, points, and sightings of these.
struct RigBundle {
  struct Pose {
    SE3 T_left_world;
    bool fixed = false;  // one pose of each connected part
  };
  struct Sighting {
    std::uint32_t pose = 0, point = 0;
    bool right = false;
    Eigen::Vector2d pixel;  // distorted, as measured [px]
    bool used = true;
  };
  StereoRig rig;
  std::vector<Pose> poses;
  std::vector<Eigen::Vector3d> points;  // world [m]
  std::vector<Sighting> sightings;

  // Measured less projected [px]; very large where the point is not in front of the camera.
  [[nodiscard]] Eigen::Vector2d residual(const Sighting& sighting) const;
};

// Prior of both cameras: standard deviations. Principal point, tangential distortion and the rig's turn are
// nearly indistinguishable on a dive, so that the first is held near the middle, as is usual in structure
// from motion; the others absorb its error.
struct CameraPrior {
  double centre = 5e-4;   // of the principal point, off the image's middle [image widths]
  double aspect = 0.001;  // of ln (fy / fx): chips have square pixels, and ports hardly change them
  double k1 = 0.5, k2 = 0.5;
  double tangential = 0.01;  // p1, p2
};

// For CameraPrior::centre, where turns, tilt and relief of a dive determine it.
inline constexpr double kFreeCentre = 0.01;

struct RigBundleConfig {
  CameraPrior prior;
  int steps = 50;
  double loss_px = 1.0;  // scale of Cauchy's loss
};

// The most likely rig, poses and points (Ceres: Levenberg-Marquardt, points eliminated). Both cameras and the
// rig's relative pose move, but for its baseline, which gives the scale, and k3, which stays. Sightings
// that are not used are skipped.
void adjust(RigBundle& bundle, const RigBundleConfig& config);

// Standard deviations at the solution, from the sightings' scatter and the whole system, priors included.
// False where the system is singular.
[[nodiscard]] bool bundleUncertainty(const RigBundle& bundle, const RigBundleConfig& config, RigSigma& sigma);

}  // namespace fathom::calibration

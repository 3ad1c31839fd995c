#pragma once

#include <vector>

#include "recon/geometry/se3.hpp"

namespace fathom::calibration {

// What happened between two exposures.
struct MotionStep {
  SE3 T_b1_b0;  // the body's motion by DVL, compass and depth: maps points of body 0 into body 1
  Eigen::Quaterniond R_c1_c0;  // the camera's rotation by what it saw
  // Middle of what it saw, in camera 0 and in camera 1 [m]. Unlike the camera's translation, it does not
  // trade against rotation: both places are seen directly.
  Eigen::Vector3d middle0, middle1;
};

// One estimate of how the camera is mounted, against what was assumed.
struct MountEstimate {
  bool known = false;                                  // enough steps
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // about body's forward, starboard, down: R_body_cam =
                                                       // exp(rotation) * assumed [rad]
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();     // standard deviations [rad]; infinite: not observable
};

struct MountAlignment {
  std::size_t steps = 0;
  double turned = 0;      // sum of the rotations' lengths [rad]
  double travelled = 0;   // [m]
  MountEstimate compass;  // from rotations alone: camera against compass; needs turns and rolling
  MountEstimate dvl;      // from displacements alone: camera against DVL; open about the direction of travel
  MountEstimate both;     // all together
  double speed_ratio = 1, speed_ratio_sigma = 0;  // distance seen over distance by DVL: the baseline's scale
  double rotation_scatter = 0;                    // of one step [rad]
  double middle_scatter = 0;                      // of one step [m]
};

// Hand-eye calibration of the camera's rotation in body (after Tsai and Lenz 1989, as robust least squares):
//   X R_c1_c0 X' = R_b1_b0,        X middle1 + p = T_b1_b0 (X middle0 + p),      X = R_body_cam, p its place,
// the place being held at `assumed`: it shows in turns alone, and weakly. Fewer than 8 steps give steps
// alone.
[[nodiscard]] MountAlignment alignMount(const std::vector<MotionStep>& steps, const SE3& assumed_T_body_cam);

}  // namespace fathom::calibration

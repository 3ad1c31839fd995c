#pragma once

#include <cstddef>
#include <vector>

#include "recon/geometry/se3.hpp"

// Checks of stereo against the vehicle's other sensors: its ranges against the DVL's, the camera's mounting
// against compass and DVL.
namespace fathom::calibration {

// Distance of the seafloor below the camera, by stereo and by the DVL [m].
struct RangeSample {
  double stereo = 0, dvl = 0;
};

struct RangeCheck {
  std::size_t samples = 0;
  double ratio = 1, ratio_sigma = 0;  // stereo = ratio * dvl
  double scatter = 0;                 // of one sample about that, relative
  double shortest = 0, longest = 0;   // of the DVL's: 5th and 95th percentile [m]
  // stereo = scale * dvl + offset; only when the ranges span enough to separate the two.
  bool line_known = false;
  double scale = 1, scale_sigma = 0;
  double offset = 0, offset_sigma = 0;  // [m]
};

// Robust: ratio by the median, line by iteratively reweighted least squares (Cauchy). Neighbouring samples
// are of the same seafloor and not independent: standard deviations come from the differences of consecutive
// blocks of samples (in order of time). Fewer than 8 samples give `samples` alone.
[[nodiscard]] RangeCheck checkRanges(const std::vector<RangeSample>& samples);

// Motion between two exposures.
struct MotionStep {
  SE3 T_b1_b0;  // the body's motion by DVL, compass and depth: maps points of body 0 into body 1
  Eigen::Quaterniond R_c1_c0;  // the camera's rotation by visual odometry
  // Middle of the points in view, in camera 0 and in camera 1 [m]. Unlike the camera's translation, it is not
  // correlated with rotation: both places are measured directly.
  Eigen::Vector3d middle0, middle1;
};

// One estimate of the camera's mounting, against the assumed one.
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
  double speed_ratio = 1,
         speed_ratio_sigma = 0;  // visual distance over distance by DVL: the baseline's scale
  double rotation_scatter = 0;   // of one step [rad]
  double middle_scatter = 0;     // of one step [m]
};

// Hand-eye calibration of the camera's rotation in body (after Tsai and Lenz 1989, as robust least squares):
//   X R_c1_c0 X' = R_b1_b0,        X middle1 + p = T_b1_b0 (X middle0 + p),      X = R_body_cam, p its place,
// the place being held at `assumed`: it shows in turns alone, and weakly. Fewer than 8 steps give `steps`
// alone.
[[nodiscard]] MountAlignment alignMount(const std::vector<MotionStep>& steps, const SE3& assumed_T_body_cam);

}  // namespace fathom::calibration

#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "recon/navigation/graph/navigation_batch.hpp"

namespace fathom::slam {

// Errors of the extrinsics and clocks as given to dead reckoning, with standard deviations.
struct Mounting {
  // Turn of the camera against attitude sensor and DVL, about its own axes: R_nav_cam = R_odom_cam exp(turn)
  // [rad]. About the axis of motion it is measured by turns of the vehicle only.
  Eigen::Vector3d camera_turn = Eigen::Vector3d::Zero(), camera_turn_sigma = Eigen::Vector3d::Zero();
  double dvl_scale = 0, dvl_scale_sigma = 0;      // true path over reckoned path, less 1
  double time_offset = 0, time_offset_sigma = 0;  // images were taken so much later than stamped [s]
  int steps = 0;                                  // used
  // Of a step with these, in the mean: Cauchy's cost, of chi-square over kLinkFree; and without the offset.
  double misfit = 0, misfit_unshifted = 0;
};

// Mounting by the steps that both visual odometry (`links` of consecutive frames) and dead reckoning
// measured, D = T_odom_a^-1 T_odom_b: the error e of the link T_a_b = D exp(e) is, to first order,
//   e_rho = R_D^T (t_D x turn + s t_D,level),   e_phi = (1 - R_D^T) turn,   e += offset (x_b - Ad(D)^-1 x_a),
// x the vehicle's twists by central differences. Least squares with Cauchy's weights; compass deviation and
// tilt bias, which change as the vehicle turns, count as noise.
[[nodiscard]] Mounting mountingOf(const std::vector<KeyframeInput>& frames,
                                  std::span<const NavigationLink> links, const SensorNoise& noise);

// By how much paths of visual odometry are longer than those of the DVL, as a logarithm, over steps that both
// measured: lengths of the DVL's own path, which an error of the compass turns and does not stretch. Huber's
// mean; sigma: by the noise of either or by how much steps differ, whichever is more, without errors of scale
// of the DVL. Nothing (steps = 0) of fewer than three.
struct PathScale {
  double longer = 0, sigma = 0;
  int steps = 0;
};
[[nodiscard]] PathScale pathScaleOf(const std::vector<KeyframeInput>& frames,
                                    std::span<const NavigationLink> links,
                                    const Eigen::Vector3d& dvl_in_camera, const SensorNoise& noise);

}  // namespace fathom::slam

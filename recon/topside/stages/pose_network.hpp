#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/se3.hpp"

namespace fathom::topside {

// A measured relative pose of two cameras of a mission.
struct CameraLink {
  std::uint32_t a = 0, b = 0;                  // indices of pairs
  SE3 T_a_b;                                   // of the left cameras
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation (translation, rotation) [m, rad]
  int inliers = 0;                             // features that it rests on
  double chi2 = 0;                             // of its residual at the solution, 6 degrees of freedom
  bool kept = true;                            // false: taken out because it contradicts the others
};

// What navigation is worth between and at images; standard deviations.
struct NetworkConfig {
  double step_position = 0.01,
         step_position_share = 0.02;                     // of dead reckoning between pairs: [m], of the way
  double step_tilt = 0.005;                              // roll and pitch between pairs [rad]
  double step_heading = 0.01, step_heading_share = 0.1;  // [rad], of the turn: deviation changes with it
  double depth = 0.05;                                   // of the pressure sensor [m]
  double tilt = 0.01;                                    // roll and pitch [rad]
  double heading = 0.1;     // compass with its deviation; errors of neighbours are alike, hence so much [rad]
  double max_chi2 = 22.46;  // of a link: 99.9 % of chi-square with 6 degrees of freedom
};

// Maximum likelihood camera poses in nav from dead-reckoned ones and links between cameras (visual odometry
// and loop closures). Terms of the graph, residuals as slam::relativePoseError:
//   dead reckoning   T_k^-1 T_k+1 as reckoned, for consecutive poses
//   depth, attitude  each pose, against the reckoned one, in nav axes; heading weakly, north and east not at
//   all links            as measured; weight by Cauchy's kernel, found again until it stays
// The first pose keeps its place. Links further than max_chi2 from the solution are taken out, the worst
// first, come back if they fit the next solution, and the rest is solved again. `chi2` and `kept` of the
// links are set.
[[nodiscard]] std::vector<SE3> solveNetwork(const std::vector<SE3>& reckoned, std::vector<CameraLink>& links,
                                            const NetworkConfig& config);

}  // namespace fathom::topside

#pragma once

#include <cstdint>
#include <vector>

#include "recon/navigation/graph/navigation_graph.hpp"

namespace fathom::slam {

// A measured relative pose of two cameras of a mission.
struct NavigationLink {
  std::uint32_t a = 0, b = 0;                  // indices of frames
  SE3 T_a_b;                                   // of the left cameras
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation (translation, rotation) [m, rad]
  int inliers = 0;                             // features that it rests on
  double chi2 = 0;                             // of its residual at the solution, 6 degrees of freedom
  double weight = 1;                           // of its information, there
  int edge = -1;                               // in the solution's graph; -1: not in force
  bool kept = true;                            // false: rejected, as it contradicts the others
  bool confirmed = false;                      // as NavigationGraph::addLink takes it

  // Visual odometry of one step, not a closure.
  [[nodiscard]] bool ofChain() const { return b == a + 1; }
};

// A position fix, as NavigationGraph::addFix takes it.
struct NavigationFix {
  int frame = 0;
  Eigen::Vector3d antenna_in_odom = Eigen::Vector3d::Zero();
  Eigen::Vector2d north_east = Eigen::Vector2d::Zero();
  double sigma = 1;      // of either component [m]
  bool by_usbl = false;  // shares SensorNoise's usbl_shift and usbl_turn with the others
  double chi2 = 0;       // at the solution, 2 degrees of freedom
  bool kept = true;
};

struct NavigationSolution {
  std::vector<SE3> poses;  // T_nav_cam of the frames
  PoseGraph graph;         // all that was measured, weights in the information, at the solution
  std::vector<int> nodes;  // of the frames in it
  NavigationGraph::Counters sensors;
  int usbl_node = -1;       // pose in `graph` of the USBL's positions, where there are any
  SE3 T_nav_usbl;           // as it was before: at their middle, level
  std::size_t certain = 0;  // edges of `graph` that are neither links nor fixes, which follow
  bool converged = true;    // at the last weights
};

// Computes maximum likelihood poses of a whole mission: the sensors' factors and the visual odometry of
// consecutive frames with the weights that NavigationGraph's gates give them; closures and fixes by truncated
// least squares, whose gates are the graph's, found by graduated non-convexity. `shift`, `sigma`: where
// odom's origin is in nav, as NavigationGraph::setAnchor. Sizes in `config` are set from the input. `chi2`
// and `kept` of links and fixes are set, and `weight` and `edge` of links. Links of consecutive frames are
// visual odometry. `before`: an earlier solution of the same input but for closures and small changes of the
// others; the sensors are not gated again, and poses start from there.
[[nodiscard]] NavigationSolution solveNavigation(const NavigationConfig& config,
                                                 const std::vector<KeyframeInput>& frames,
                                                 const Eigen::Vector2d& shift, double sigma,
                                                 std::vector<NavigationLink>& links,
                                                 std::vector<NavigationFix>& fixes,
                                                 NavigationSolution before = {});

// `noise` as it shows before anything is solved, by steps that dead reckoning and visual odometry (`links`)
// both measured: a compass in turns or over iron, roll and pitch in swell, a DVL over sea grass may err by
// more than instruments of their class, and gates that do not know it take right images for wrong ones.
// `dvl_in_camera`: the DVL's place [m].
[[nodiscard]] SensorNoise noiseBySteps(const SensorNoise& noise, const std::vector<KeyframeInput>& frames,
                                       const std::vector<NavigationLink>& links,
                                       const Eigen::Vector3d& dvl_in_camera);

// `noise` adapted to a solved dive: the error that all readings of a sensor share is at least as large as the
// variation of its readings over the dive (a compass deviation that changes by ten degrees from line to line
// may be off by as much on all of them; roll and pitch likewise); the error of one reading, as the change to
// the next; the shift of the USBL, as the residuals of three quarters of its positions.
[[nodiscard]] SensorNoise adaptedNoise(const SensorNoise& noise, const std::vector<KeyframeInput>& frames,
                                       const std::vector<NavigationFix>& fixes,
                                       const NavigationSolution& solved);

}  // namespace fathom::slam

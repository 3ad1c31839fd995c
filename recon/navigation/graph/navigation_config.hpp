#pragma once

#include "realtime/base/config_keys.hpp"
#include "recon/navigation/sensors/dvl_calibration.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {

// Sizes, gates and noise of a NavigationGraph.
struct NavigationConfig {
  int max_keyframes = 8000;  // at once: for another one, the least needed retires
  int max_links = 16000;     // of these, visual odometry and closures
  int max_fixes = 4000;
  double reference_s = 20;       // a reference of attitude serves so long [s]
  double reference_turn = 0.17;  // and over so much turning [rad]
  double jump_heading = 0.3;  // standard deviation of heading's reference after a jump of the compass [rad]
  double gate = 22.46;        // squared Mahalanobis distance of a link: chi-square, 6 degrees, 99.9 %
  // Factor on the graph's own covariance in the gates of closures, fixes and
  // recognised places: links share errors that it takes for independent, and
  // after a long path its standard deviations are half of what they should be.
  double known_scale = 4;
  // Standard deviations by which compass and visual turn differ in a step that is counted as contradicted.
  double turned_sigmas = 4;
  double fix_gate = 13.82;    // of a fix: 2 degrees, 99.9 %
  int reject_after = 5;       // contradictions in a row that reject a sensor
  int reweighted = 6;         // links and fixes that one step reweights
  double change_m = 0.01;     // smallest move of a keyframe that is reported [m]
  double change_rad = 0.005;  // and turn [rad]
  Eigen::Vector3d dvl_in_camera = Eigen::Vector3d::Zero();  // its place in the camera's axes [m]
  RigPrior rig;
  Eigen::Vector3d forward_in_camera = kForward;  // the body's axis ahead there [1]
  SensorNoise noise;
  IncrementalConfig solver;  // its sizes are set from the above

  void validate() const;  // throws std::invalid_argument, which names the value that is out of range
};

// The keys of a [sensors] table, the errors of the navigation sensors: the same on board and topside. A
// reader throws std::invalid_argument for values that do not fit each other.
void visitSensorNoise(KeyVisitor& keys, SensorNoise& noise);

// The same where mission.toml predicts the tide: harmonic constants leave a part of its rate. And where it
// does not: the sea's height over nav's zero is unknown by half a metre, as for a tide of 0.7 m.
[[nodiscard]] SensorNoise withTide(SensorNoise noise, bool predicted);

}  // namespace fathom::slam

#pragma once

#include "realtime/kernel/config_table.hpp"
#include "recon/slam/dvl_calibration.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/sensor_factors.hpp"

namespace fathom::slam {

// Of NavigationGraph.
struct NavigationConfig {
  int max_keyframes = 8000;  // at once: for another one, the least needed retires
  int max_links = 16000;     // of these, visual odometry and closures
  int max_fixes = 4000;
  double reference_s = 20;       // a reference of attitude serves so long [s]
  double reference_turn = 0.17;  // and over so much turning [rad]
  double jump_heading = 0.3;  // standard deviation of heading's reference after a jump of the compass [rad]
  double gate = 22.46;        // squared Mahalanobis distance of a link: chi-square, 6 degrees, 99.9 %
  // Of the graph's own covariance where a closure, a fix, or a place that was recognised without it, is
  // judged by it: links share errors that it takes for independent, and after a long way its standard
  // deviations are half of what they should be.
  double known_scale = 4;
  // Standard deviations by which compass and visual turn differ in a step that is counted as contradicted.
  double turned_sigmas = 4;
  double fix_gate = 13.82;    // of a fix: 2 degrees, 99.9 %
  int lying_after = 5;        // contradictions in a row by which a sensor is taken to lie
  int reweighted = 6;         // links and fixes a step whose robust weight is looked at again
  double change_m = 0.01;     // smallest move of a keyframe that is reported [m]
  double change_rad = 0.005;  // and turn [rad]
  Eigen::Vector3d dvl_in_camera = Eigen::Vector3d::Zero();  // its place in the camera's axes [m]
  RigPrior rig;
  Eigen::Vector3d forward_in_camera = kForward;  // the body's axis ahead there [1]
  SensorNoise noise;
  IncrementalConfig solver;  // its sizes are set from the above

  void validate() const;  // throws std::invalid_argument
};

// Reads the keys of a [sensors] table, the errors of the navigation sensors (README.md lists them with units
// and ranges), over `defaults`. The same on board and topside. Throws InputError; keys that it does not know
// are left for the caller's finish().
[[nodiscard]] SensorNoise readSensorNoise(const ConfigTable& table, const SensorNoise& defaults);

// The same where nobody predicts the tide: the sea's height over nav's zero is unknown by half a metre, as a
// tide of 0.7 m leaves it. Topside, which claims heights: on board nobody is shown any such claim.
[[nodiscard]] SensorNoise withoutTideModel(SensorNoise noise);
// And where mission.toml predicts it: what harmonic constants leave of its rate.
[[nodiscard]] SensorNoise withTideModel(SensorNoise noise);

}  // namespace fathom::slam

#pragma once

#include <vector>

#include "recon/solver/pose_graph.hpp"

namespace fathom::test {

// Ends of a synthetic survey's loop closures.
enum class Closures {
  kNeighbours,  // neighbouring lines and crossing lines, as footprints overlap
  kAnywhere     // any two keyframes: the worst case for a solver
};

struct SurveyPlan {
  int keyframes = 20000;
  int closures = 2000;
  Closures where = Closures::kNeighbours;
  double spacing = 0.9;             // of keyframes along the track [m]
  double line_length = 200;         // [m]
  double line_spacing = 2.5;        // [m]
  double cross_line_spacing = 8;    // [m]
  double share_of_lines = 0.8;      // of keyframes; the rest are on cross lines, which come last
  double odometry_shift = 0.01;     // standard deviations, between keyframes [m]
  double odometry_turn = 0.001;     // [rad]
  double closure_shift = 0.02;      // of a closure [m]
  double closure_turn = 0.005;      // [rad]
  double overlap = 2.6;             // farthest that two keyframes of a closure are apart [m]
  bool attitude_and_depth = false;  // one more measurement of each pose, of tilt, heading and depth
  unsigned seed = 1;
};

struct Survey {
  slam::PoseGraph graph;  // its poses are dead reckoning
  std::vector<SE3> truth;
};

// A lawn-mower survey with cross lines, at 2 m over a plane. The same plan gives the same survey.
[[nodiscard]] Survey makeSurvey(const SurveyPlan& plan);

}  // namespace fathom::test

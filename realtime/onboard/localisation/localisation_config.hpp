#pragma once

#include <cstddef>

#include "recon/closure/registration.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"

namespace fathom::onboard {

struct LocalisationConfig {
  bool enabled = true;
  int max_keyframes = 8000;  // at once: the newest and the most needed; their memory is taken at the start
  double keyframe_overlap = 0.7;      // a new keyframe where the footprint shares less with the last one's
  double keyframe_turn = 0.35;        // or after so much turning [rad]
  double keyframe_s = 4;              // or after so long [s]
  int features = 600;                 // of a keyframe
  int closures_per_keyframe = 2;      // registrations tried for closures
  int place_tries = 4;                // and without prior, where nothing was closed for a while
  int predictions_per_keyframe = 48;  // relative covariances asked of the graph
  std::size_t closures_waiting = 500;
  slam::NavigationConfig graph;  // its max_keyframes is set from the above
};

}  // namespace fathom::onboard

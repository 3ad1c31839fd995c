#pragma once

#include <vector>

#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// Closures between frames of which the solution does not know that they show the same ground: frames that no
// closure reaches over a long distance are recognised by their features alone (closure::PlaceIndex),
// registered without prior (closure::recognitionRules), and accepted where several agree around a cycle of
// odometry (closure::Agreement). `links`: all that are known. The result does not depend on the number of
// threads.
[[nodiscard]] std::vector<slam::NavigationLink> recognisePlaces(
    const StereoRig& rig, const Frames& frames, const slam::NavigationSolution& solution,
    const std::vector<slam::NavigationLink>& links);

}  // namespace fathom::topside

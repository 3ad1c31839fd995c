#pragma once

#include <functional>
#include <vector>

#include "recon/closure/descriptor_matching.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// The features that each link rests on, which are not kept: every link is registered once more about its own
// result. `visit` is called one by one, in order of the links; none where that fails.
void forEachMatched(const StereoRig& rig, const Frames& frames,
                    const std::vector<slam::NavigationLink>& links,
                    const std::function<void(std::size_t link, const std::vector<closure::Match>&)>& visit);

}  // namespace fathom::topside

#pragma once

#include <vector>

#include "recon/closure/registration.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// Of consecutive frames, looser than of closures: a ledge or a fish may fill most of the shared view.
[[nodiscard]] closure::RegistrationConfig stepRules();
// As dead reckoning knows it.
[[nodiscard]] closure::RelativePrior stepPrior(const SE3& T_a_b);

// Visual odometry: links between consecutive frames, with dead reckoning as prior; where that is contradicted
// (a compass that leapt, a DVL that is wrong or was silent), once more with a wide prior and the stricter
// rules of closures. One that turns otherwise than dead reckoning is confirmed where a link from the frame
// before, found with a wide prior, comes to the same pose. The result does not depend on the number of
// threads.
[[nodiscard]] std::vector<slam::NavigationLink> visualOdometry(const StereoRig& rig, const Frames& frames);

}  // namespace fathom::topside

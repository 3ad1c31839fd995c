#pragma once

#include <span>
#include <vector>

#include "recon/closure/registration.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/survey_stage.hpp"
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

// Steps without features to speak of, from all pixels (alignGround): links to the frames `steps` from those
// before them, of those that were found. A step whose images cannot be read is not. `reckoned`: frames know
// their turns by the vehicle's sensors.
[[nodiscard]] std::vector<slam::NavigationLink> groundSteps(const MissionInput& input, const Survey& survey,
                                                            const Frames& frames,
                                                            std::span<const std::uint32_t> steps,
                                                            bool reckoned);
// `odometry`, by rising frames, with the steps that it lacks where the ground shows them.
[[nodiscard]] std::vector<slam::NavigationLink> withGroundSteps(const MissionInput& input,
                                                                const Survey& survey, const Frames& frames,
                                                                std::vector<slam::NavigationLink> odometry);

// Closures between frames of which the solution does not know that they show the same ground: frames that no
// closure reaches over a long distance are recognised by their features alone (closure::PlaceIndex),
// registered without prior (closure::recognitionRules), and accepted where several agree around a cycle of
// odometry (closure::Agreement). `links`: all that are known. The result does not depend on the number of
// threads.
[[nodiscard]] std::vector<slam::NavigationLink> recognisePlaces(
    const StereoRig& rig, const Frames& frames, const slam::NavigationSolution& solution,
    const std::vector<slam::NavigationLink>& links);

}  // namespace fathom::topside

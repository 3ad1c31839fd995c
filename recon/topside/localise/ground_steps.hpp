#pragma once

#include <span>
#include <vector>

#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// Steps without features to speak of, from all pixels (alignGround): links to the frames `steps` from those
// before them, of those that were found. A step whose images cannot be read is not.
[[nodiscard]] std::vector<slam::NavigationLink> groundSteps(const MissionInput& input, const Survey& survey,
                                                            const Frames& frames,
                                                            std::span<const std::uint32_t> steps);

}  // namespace fathom::topside

#pragma once

#include "recon/topside/stages/image_pairs.hpp"
#include "recon/topside/stages/mission_input.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// The mission's pairs and where the vehicle's own sensors, or the poses that were given, have them.
struct Survey {
  PairList list;
  Navigation navigation;
};

// Throws InputError: see listPairs() and navigate().
[[nodiscard]] Survey takeSurvey(const MissionInput& input, const TopsideConfig& config);

}  // namespace fathom::topside

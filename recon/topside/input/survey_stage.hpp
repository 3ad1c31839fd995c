#pragma once

#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/navigation.hpp"

namespace fathom::topside {

// The mission's pairs and where the vehicle's own sensors, or the poses that were given, have them.
struct Survey {
  PairList list;
  Navigation navigation;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.list, self.navigation);
  }
};

[[nodiscard]] Digest surveyKey(const MissionInput& input, const TopsideConfig& config);
// Throws InputError: see listPairs() and navigate().
[[nodiscard]] Survey takeSurvey(const MissionInput& input, const TopsideConfig& config);

}  // namespace fathom::topside

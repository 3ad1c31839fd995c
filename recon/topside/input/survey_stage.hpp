#pragma once

#include "recon/import/images/image_pairs.hpp"
#include "recon/import/navigation/nav_data.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::stereo {

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<SeedPlane> auto& plane) {
  archive(plane.normal, plane.distance);
}

}  // namespace fathom::stereo

namespace fathom::topside {

// The mission's pairs, where the vehicle's own sensors, or the poses that were given, have them, and what
// they should see.
struct Survey {
  PairList list;
  Navigation navigation;
  SeedPlanes planes;
  std::vector<KnownPose> known;  // by pair, where files of navigation were given

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.list, self.navigation, self.planes, self.known);
  }
};

// Into the keys of results.
void addPlane(Hasher& hasher, const std::optional<stereo::SeedPlane>& plane);

// The pairs of a folder of images alone.
[[nodiscard]] PairList pairsOf(const MissionInput& input);
[[nodiscard]] Digest surveyKey(const MissionInput& input, const TopsideConfig& config);
// Whether the camera looks so much aside that what it sees, a wall as a rule, is not what the altimeter
// measures: images tell where it is.
[[nodiscard]] bool seesBeside(const MissionInput& input);
// Throws InputError: see listPairs() and navigate().
[[nodiscard]] Survey takeSurvey(const MissionInput& input, const TopsideConfig& config);

}  // namespace fathom::topside

#pragma once

#include <cstdint>
#include <vector>

#include "recon/import/images/image_pairs.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/navigation_seed_plane.hpp"

namespace fathom::topside {

// Contrast enough for stereo before there is a model of the light: an image's mean becomes a third of full
// scale.
[[nodiscard]] std::vector<std::uint8_t> stretchedGrey(const ImageView& image);

// Planes of pairs of which no navigation tells: from the images themselves (stereo::PlaneScout); a pair that
// shows none has that of the nearest one that does. By as many threads as are allowed,
// which the result does not depend on.
[[nodiscard]] SeedPlanes scoutPlanes(const MissionInput& input, const TopsideConfig& config,
                                     const PairList& list);

}  // namespace fathom::topside

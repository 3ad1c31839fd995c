#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/navigation.hpp"

namespace fathom::topside {

// Where a pair's seafloor should be, in the left camera frame; none: nobody knows.
using SeedPlanes = std::vector<std::optional<stereo::SeedPlane>>;

// Cosine of the principal ray from the vertical, below which a camera looks ahead rather than down.
inline constexpr double kLooksAhead = 0.3;

// A level seafloor `altitude` below the DVL.
[[nodiscard]] stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body,
                                          double altitude);

// The same for each pose, by the DVL's altitude [m]: the last one known where it has none,
// `default_altitude` before the first. A camera that looks ahead sees something else than the ground below:
// a plane across its axis, so far away.
[[nodiscard]] SeedPlanes seedPlanes(const io::MissionConfig& mission, const std::vector<NavigatedPose>& poses,
                                    double default_altitude);

// Contrast enough for stereo before there is a model of the light: an image's mean becomes a third of full
// scale.
[[nodiscard]] std::vector<std::uint8_t> stretchedGrey(const ImageView& image);

// Planes of pairs of which no navigation tells: from the images themselves (stereo::PlaneScout); a pair that
// shows none has that of the nearest one that does. By as many threads as are allowed,
// which the result does not depend on.
[[nodiscard]] SeedPlanes scoutPlanes(const MissionInput& input, const TopsideConfig& config,
                                     const PairList& list);

}  // namespace fathom::topside

#pragma once

#include <optional>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/stereo/sparse_stereo.hpp"
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

}  // namespace fathom::topside

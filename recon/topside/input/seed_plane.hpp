#pragma once

#include <vector>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/input/navigation.hpp"

namespace fathom::topside {

// A level seafloor `altitude` below the DVL, in the camera frame.
[[nodiscard]] stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body,
                                          double altitude);

// The DVL's altitude at each pose [m]: the last one known where it has none, `default_altitude` before the
// first.
[[nodiscard]] std::vector<double> seedAltitudes(const std::vector<NavigatedPose>& poses,
                                                double default_altitude);

}  // namespace fathom::topside

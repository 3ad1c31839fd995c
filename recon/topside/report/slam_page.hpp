#pragma once

#include <filesystem>

#include "recon/topside/input/navigation.hpp"
#include "recon/topside/report/consistency.hpp"

namespace fathom::topside {

// slam.html: both tracks from above with the closures (after figure 9 of Johnson-Roberson et al. 2010), how
// far closures disagree with dead reckoning and with the solved poses (their figure 10), counts, what was
// found of the sensors; and against a simulated mission's truth, errors beside the standard deviations
// claimed.
void writeSlamPage(const std::filesystem::path& file, const SlamResult& slam, const Navigation& navigation,
                   const SE3& T_body_cam, bool features_only, const Consistency& truth);

}  // namespace fathom::topside

#pragma once

#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// Every setting that a stage's result depends on, into the key of that result. A setting that is new in one
// of these structures belongs here too: their sizes are checked.
void addNavigationSettings(Hasher& hasher, const TopsideConfig& config);
void addLightingSettings(Hasher& hasher, const TopsideConfig& config);
void addStereoSettings(Hasher& hasher, const TopsideConfig& config);
void addSlamSettings(Hasher& hasher, const TopsideConfig& config);
void addFusionSettings(Hasher& hasher, const TopsideConfig& config);
void addModelSettings(Hasher& hasher, const TopsideConfig& config);

// The calibration and the mission's mounting, formats and offsets.
void addRig(Hasher& hasher, const MissionInput& input);
void addPose(Hasher& hasher, const SE3& pose);

}  // namespace fathom::topside

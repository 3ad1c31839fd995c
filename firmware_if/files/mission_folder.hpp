#pragma once

#include <filesystem>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Makes a folder to record into: mission.toml, stereo.calib and img/. Where a mission of the same vehicle and
// dive lies already, its files stay and its configuration is returned; with `replace` what was recorded there
// is removed first. Throws InputError for a folder that cannot be written, that holds other things than a
// mission, or, without `replace`, the mission of another vehicle or dive.
MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig, bool replace);

}  // namespace fathom::io

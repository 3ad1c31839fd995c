#pragma once

#include <filesystem>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Makes a folder to record into: mission.toml, stereo.calib and img/. Where a mission of the same vehicle and
// dive lies already, its files stay and its configuration is returned. Throws InputError for a folder that
// cannot be written, that holds other things than a mission, or the mission of another vehicle or dive.
MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig);

// Writes <vehicle>_<start time>.RAW.auv from the log of a mission folder.
void deriveRawAuv(const std::filesystem::path& folder);

}  // namespace fathom::io

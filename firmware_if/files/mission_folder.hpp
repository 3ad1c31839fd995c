#pragma once

#include <filesystem>
#include <functional>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Makes a folder to record into: mission.toml, stereo.calib and img/. Where a mission of the same vehicle and
// dive is already, its files stay and its configuration is returned. Throws InputError for a path that can
// be no folder, one that holds other things than a mission, or the mission of another vehicle or dive, and
// another std::exception when the disk refuses.
MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig);

// Writes <vehicle>_<start time>.RAW.auv from the log of a mission folder: whole under that name, or not at
// all. Gives up, with false, when `go_on` says so; it is asked every now and then. Throws InputError for a
// log without a sample, or one that cannot be read to its end, and another std::exception when the disk
// refuses.
bool deriveRawAuv(const std::filesystem::path& folder, const std::function<bool()>& go_on = {});

}  // namespace fathom::io

#pragma once

#include "firmware_if/camera/camera_config.hpp"
#include "firmware_if/files/mission.hpp"
#include "firmware_if/predive/predive_config.hpp"
#include "firmware_if/predive/predive_report.hpp"
#include "firmware_if/predive/predive_watch.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/kernel/system_clock.hpp"
#include "realtime/kernel/tiers/arming.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// Rows of the table from what was read and seen; pure. `adds` green, red or unused rows.

// Sensors' places on the vehicle and the stereo rig, as mission.toml and stereo.calib have them.
void checkExtrinsics(const MissionConfig& mission, const StereoRig& rig, const PrediveConfig& limits,
                     PrediveReport& report);

// Each camera: there, the one of the calibration, its size and rate; focus, exposure. Then the pair: exposed
// together, lit alike.
void checkCameras(const PrediveFacts& facts, const StereoCameraConfig& cameras, const MissionConfig& mission,
                  const StereoRig& rig, const PrediveConfig& limits, PrediveReport& report);

// DVL, compass, depth, battery, GPS, USBL and modem: alive, at their rates. `origin`: of the mission, which
// no fix is far from.
void checkSensors(const PrediveFacts& facts, const MissionConfig& mission, const PrediveConfig& limits,
                  PrediveReport& report);

// System's, cameras' and DVL's clocks.
void checkClocks(const PrediveFacts& facts, const rt::SystemClockState& system, const PrediveConfig& limits,
                 PrediveReport& report);

// Room on the disk for the planned hours; memory and privileges for real time.
void checkDisk(const RecorderConfig& recorder, const MissionConfig& mission, const StereoRig& rig,
               std::uint64_t free_bytes, PrediveReport& report);
void checkArming(const rt::ArmingResult& arming, PrediveReport& report);

}  // namespace fathom::io

#pragma once

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// What the vehicle is told of itself: mission.toml and stereo.calib, which are wrong by as much as the
// scenario's calibration_errors say. Which way is drawn from a stream of its own.
struct ToldRig {
  StereoRig rig;
  io::MissionConfig mission;
};
[[nodiscard]] ToldRig toldRig(const CalibrationErrors& errors, const StereoRig& rig,
                              const io::MissionConfig& mission, std::uint64_t seed);

}  // namespace fathom::sim

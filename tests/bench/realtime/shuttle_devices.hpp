#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>

#include "firmware_if/files/mission.hpp"
#include "realtime/onboard/live/live_system.hpp"
#include "tests/bench/realtime/shuttle.hpp"

namespace fathom::bench {

// A shuttle as devices that give each sample and exposure when its time has come by the vehicle's clock.
// Pixels come from a scratch file without a name, decoded once, so that giving one out takes no heap. All
// arguments must outlive the devices.
[[nodiscard]] onboard::LiveDevices shuttleDevices(const Shuttle& shuttle, const std::filesystem::path& images,
                                                  const std::filesystem::path& scratch_folder,
                                                  const io::MissionConfig& mission, const StereoRig& rig,
                                                  const rt::VehicleClock& clock, std::int64_t begin_utc_ns,
                                                  std::uint64_t pairs, std::atomic<std::uint64_t>& given);

}  // namespace fathom::bench

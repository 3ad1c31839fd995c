#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/log/onboard_input.hpp"
#include "realtime/onboard/live/live_system.hpp"

namespace fathom::test {

// A recorded mission's inputs as devices give them: each when its time has come by the vehicle's clock.
struct PlayedMission {
  std::vector<io::OnboardInput> inputs;
  std::int64_t shift_ns = 0;  // added to the mission's times gives the vehicle's
  std::size_t first = 0;      // that is played

  // So that the first input comes `lead_s` from now.
  PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock, double lead_s);
  // With that shift; what was due by now has been missed.
  PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock,
                std::int64_t with_shift_ns);
  [[nodiscard]] double lengthSeconds() const;
  [[nodiscard]] std::int64_t dueNs(std::size_t input) const {
    return inputs[input].arrival_utc_ns + shift_ns;
  }
};

// Of a dive in `folder` with the mission and calibration of that one, in soft mode and with pools for some
// minutes; `anew`: what was in the folder is removed. As on a vehicle, the two lie there before the dive.
[[nodiscard]] onboard::LiveSetup liveSetup(const std::filesystem::path& mission,
                                           const std::filesystem::path& folder, bool anew);
// A replay must find the pools that the dive had: this configuration.
constexpr const char* kLivePools = "[slam]\nmax_pairs = 400\nmax_keyframes = 400\n";

struct PlayedOptions {
  std::size_t pool_frames = 12;
  std::uint64_t lost_left = UINT64_MAX;  // this exposure of the left camera never comes
};

// Two cameras and one source of everything else. The mission must outlive them.
[[nodiscard]] onboard::LiveDevices playedDevices(const PlayedMission& played,
                                                 const std::filesystem::path& folder,
                                                 const io::MissionConfig& mission, const StereoRig& rig,
                                                 const rt::VehicleClock& clock,
                                                 const PlayedOptions& options = {});

}  // namespace fathom::test

#pragma once

#include <cstdint>
#include <filesystem>

#include "firmware_if/files/mission.hpp"
#include "realtime/onboard/onboard_config.hpp"

namespace fathom::onboard {

// Of a dive that may have to be gone on with: saved states, slots, clock, lock.
[[nodiscard]] inline std::filesystem::path stateFolder(const std::filesystem::path& mission) {
  return mission / "state";
}

// What a saved state must have been made with to be of use.
struct CheckpointNames {
  std::uint64_t configuration = 0, mission = 0;
};
// Of the texts of configuration, mission.toml, calibration and colours; of vehicle and dive. What of them
// cannot be read counts as empty.
[[nodiscard]] CheckpointNames checkpointNames(const std::filesystem::path& folder,
                                              const OnboardConfig& config, const io::MissionConfig& mission);

}  // namespace fathom::onboard

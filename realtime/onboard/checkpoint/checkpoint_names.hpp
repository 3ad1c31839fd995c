#pragma once

#include <cstdint>
#include <filesystem>

#include "firmware_if/mission/mission.hpp"
#include "realtime/onboard/onboard_config.hpp"

namespace fathom::onboard {

// Folder with what a restart needs to continue a dive: saved states, slots, clock, lock.
[[nodiscard]] inline std::filesystem::path stateFolder(const std::filesystem::path& mission) {
  return mission / "state";
}

// Hashes that a saved state must match to be usable.
struct CheckpointNames {
  std::uint64_t configuration = 0, mission = 0;
};
// Hashes of the texts of configuration, mission.toml, calibration and colours, and of vehicle and dive. Files
// that cannot be read count as empty.
[[nodiscard]] CheckpointNames checkpointNames(const std::filesystem::path& folder,
                                              const OnboardConfig& config, const io::MissionConfig& mission);

}  // namespace fathom::onboard

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/log/onboard_input.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/onboard_config.hpp"

namespace fathom::onboard {

// What an earlier run of the program left of this dive: its newest whole checkpoint, and the log behind it.
// Nothing, for a dive that begins.
struct Resume {
  std::optional<CheckpointFiles::Found> checkpoint;  // absent: the log is consumed from its beginning
  std::vector<io::OnboardInput> tail;
  std::map<std::uint32_t, io::Decision> decisions;  // about pairs of the tail
  std::int64_t last_ns = 0;                         // arrival of the newest input; 0: the dive begins
  std::uint64_t newest_number = 0;                  // of any checkpoint in the log
  std::vector<std::string> said;                    // about checkpoints that were passed over

  [[nodiscard]] bool any() const { return last_ns != 0; }
  [[nodiscard]] std::uint64_t number() const { return checkpoint ? checkpoint->head.number : 0; }
};

struct CheckpointNames {
  std::uint64_t configuration = 0, mission = 0;
};
// Of the configuration's text, the calibration and mission.toml; of vehicle and dive.
[[nodiscard]] CheckpointNames checkpointNames(const std::filesystem::path& folder,
                                              const OnboardConfig& config, const io::MissionConfig& mission);

// Removes a checkpoint that the log does not reach to. Throws InputError for a dive that has ended, or a log
// that cannot be read.
[[nodiscard]] Resume readResume(const std::filesystem::path& folder, CheckpointFiles& files,
                                const CheckpointNames& names);

// UTC less the monotonic clock: as an earlier run on this machine, since it was started, had it; else the
// system's; but vehicle time begins behind `last_ns`, the newest arrival of the dive's log (0: the dive
// begins). `clock_behind_ns`, where given, gets by how much the clock lay behind the log's end, 0 where it
// did not.
[[nodiscard]] std::int64_t vehicleClockOffset(const std::filesystem::path& state_folder,
                                              std::int64_t last_ns = 0,
                                              std::int64_t* clock_behind_ns = nullptr);

}  // namespace fathom::onboard

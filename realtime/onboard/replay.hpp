#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "realtime/onboard/mission_run.hpp"
#include "realtime/onboard/onboard_config.hpp"

namespace fathom::onboard {

struct ReplayOptions {
  std::filesystem::path mission;
  std::optional<std::filesystem::path> config;  // TOML; absent: defaults
  std::optional<std::filesystem::path> out;     // absent: <mission>/onboard
  bool no_slam = false;                         // whatever the configuration says
  FrameExchangeOptions link;                    // the modem, in both directions
  double drain_s = 0;  // sending continues after the last sample until all is sent, at most so long [s]
};

struct ReplaySummary : RunSummary {
  std::uint64_t damaged_entries = 0;
  double wall_s = 0;  // of the replay
};

// Feeds a recorded (or simulated) mission to the three cores in logged order and writes onboard/. Everything
// but timing.json depends only on the mission, the configuration and the received frames (downlink.bin): two
// replays give identical bytes. Throws InputError for an unusable mission; an unreadable image is counted and
// its pair dropped.
ReplaySummary replay(const ReplayOptions& options);
// One line for the operator.
[[nodiscard]] std::string describe(const ReplaySummary& summary);

}  // namespace fathom::onboard

#pragma once

#include <filesystem>
#include <optional>

namespace fathom::onboard {

struct LiveOptions {
  std::filesystem::path folder;  // with mission.toml and stereo.calib; the recording goes there
  std::optional<std::filesystem::path> config;    // TOML; absent: defaults, and no devices
  std::optional<std::filesystem::path> timeline;  // trace of one second of all tiers, near the end
  bool soft = false;                              // without the privileges of real time, whatever is missing
  bool print_budget = false;                      // show the memory plan and end
  double for_s = 0;                               // end by itself after so long; 0: at SIGTERM or SIGINT
};

// The vehicle's program: opens the devices, arms, maps until it is told to end, and writes onboard/. Prints
// "armed" on a line of its own when the hard tier runs. Returns the exit code; throws InputError.
int runLive(const LiveOptions& options);

}  // namespace fathom::onboard

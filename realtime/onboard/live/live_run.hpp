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
  double for_s = 0;                               // end the dive after so long; 0: on request
};

// The vehicle's program: opens the devices, arms, and runs until an end is requested. SIGINT or SIGUSR1: the
// dive ends, onboard/ is written. SIGTERM: the program ends, the dive continues when it is started again; a
// second SIGTERM ends at once. Prints "armed" on a line of its own when the hard tier runs. Returns the exit
// code; throws InputError.
int runLive(const LiveOptions& options);
// Makes the program that dives in the folder end its dive, and waits for it. Throws InputError if there is
// none.
int endDive(const std::filesystem::path& folder);

}  // namespace fathom::onboard

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sim/link/simulated_ship.hpp"

namespace fathom::sim {

struct HilOptions {
  std::filesystem::path mission;                // what is played
  std::filesystem::path out;                    // RUN: all results
  std::optional<std::filesystem::path> faults;  // script
  std::optional<std::filesystem::path> config;  // onboard.toml without the tables of devices
  std::filesystem::path onboard;                // fathom-onboard; empty: beside this program
  std::vector<std::string> onboard_options;     // more of its options ("--soft")
  bool wait = false;        // the operator starts the program; no clock steps, no disk of its own
  bool force = false;       // replaces an earlier run
  bool no_compare = false;  // plays only
  double from_s = 0, seconds = 0, rate = 1;
  int laps = 1;
  double lead_s = 12;  // from the bench's start to the mission's, for discovery and arming
  bool udp_modem = false;
  double left_ppm = 37, right_ppm = -52;  // drift of the cameras' clocks
  SimulatedShipOptions water;
};

// fathom-sim hil: plays the mission through real interfaces to the real program, with the script's faults,
// and compares. Exit code: 0 when the program succeeded and every check passes, 1 otherwise. Throws
// InputError.
int runHil(const HilOptions& options);

}  // namespace fathom::sim

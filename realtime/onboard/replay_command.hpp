#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "realtime/onboard/replay.hpp"
#include "sim/link/simulated_ship.hpp"

namespace fathom::onboard {

// `fathom-onboard --replay MISSION`: its options, and what it does with them.
class ReplayCommand {
 public:
  // `replay`: the option --replay, which the others need.
  void addOptions(CLI::App& app, CLI::Option* replay);
  // Returns the exit code; throws InputError.
  int run(const std::string& mission, const std::string& config);

 private:
  std::string out_, modem_, downlink_, heard_;
  ReplayOptions options_;
  sim::SimulatedShipOptions water_;
  std::optional<double> water_rate_;
  std::vector<double> off_;
};

}  // namespace fathom::onboard

#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "realtime/onboard/replay.hpp"

namespace fathom::onboard {

// `fathom-onboard --replay MISSION`: its options, and what it does with them.
class ReplayCommand {
 public:
  // `replay`: the option --replay, which the others need.
  void addOptions(CLI::App& app, CLI::Option* replay);
  // Returns the exit code; throws InputError.
  int run(const std::string& mission, const std::string& config);

 private:
  std::string out_, modem_, downlink_;
  ReplayOptions options_;
};

}  // namespace fathom::onboard

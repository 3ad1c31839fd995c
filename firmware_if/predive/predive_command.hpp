#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/predive/predive_watch.hpp"
#include "realtime/base/config_table.hpp"

namespace fathom::io {

// `fathom-sensors predive FOLDER --config onboard.toml`.
struct PrediveCommand {
  std::filesystem::path folder;  // of the mission: mission.toml, stereo.calib; will be recorded into
  std::filesystem::path config;  // onboard.toml
  double seconds = 10;           // that the devices are looked at
  bool json = false;
  bool colours = false;
};

// Makes the link's part from the mission and the table `[link]` of onboard.toml.
using MakePrediveLink = std::function<PrediveLink(const MissionConfig&, const ConfigTable& link)>;

// Looks at everything, prints the table (or JSON) to `out`. Returns the exit code: 0 when every row is green,
// else 1; files that cannot be read are red rows too. Nothing is written; nothing is sent but what setting up
// a camera takes and, over the modem, a status every five seconds.
int runPrediveCommand(const PrediveCommand& command, const MakePrediveLink& make_link, std::FILE* out);

}  // namespace fathom::io

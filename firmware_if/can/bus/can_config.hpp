#pragma once

#include <string>

#include "firmware_if/can/samples/n2k_samples.hpp"
#include "firmware_if/can/send/can_sender.hpp"
#include "realtime/kernel/config_table.hpp"

namespace fathom::io {

// The `[can]` table of onboard.toml, with `[can.send]`; keys, units and ranges are in the folder's README.
struct CanConfig {
  std::string interface;       // empty: no CAN
  N2kSamples::Config samples;  // latitude is the mission's: the caller sets it
  bool send = false;           // tell others on the bus where the vehicle is and how the map stands
  CanSender::Config sender;    // software_version: the caller sets it
};

// Values of `table`, else of `defaults`. Throws InputError for a value out of range.
[[nodiscard]] CanConfig readCanConfig(const ConfigTable& table, CanConfig defaults);

}  // namespace fathom::io

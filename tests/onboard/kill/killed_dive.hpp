#pragma once

#include <cstdint>
#include <filesystem>

#include "realtime/onboard/onboard_config.hpp"

namespace fathom::test {

// What the program on the vehicle is told, by its parent.
struct DiveOrders {
  std::filesystem::path folder;   // of the dive
  std::filesystem::path mission;  // that is played
  std::filesystem::path config;   // TOML
  std::int64_t shift_ns = 0;      // added to the mission's times gives the vehicle's
};

// Dives live in soft mode, its devices played at their real rate and its modem a socket, until SIGTERM. On
// stdout a line for everything that the parent wants to know (see DiveLine). Exit status.
int dive(const DiveOrders& orders);

// The socket to the ship, in the child.
constexpr int kModemSocket = 3;

// The lines, one letter and numbers each; monotonic times are the machine's.
//   R away_s first                goes on with a dive; the first input it is given
//   C checkpoint                  the mapper has begun with it
//   F first                       a dive begins
//   A mono_ns                     armed
//   N mono_ns                     the hard tier has put inputs in order
//   S mono_ns utc_ns pairs keyframes tiles arrived    after catching up, some times a second
//   # text                        what the program says
struct DiveState {
  std::int64_t mono_ns = 0, utc_ns = 0;  // utc: of the newest input consumed
  std::uint64_t pairs = 0, keyframes = 0, tiles = 0;
  std::uint64_t arrived = 0;  // frames that the ship acknowledged
};

}  // namespace fathom::test

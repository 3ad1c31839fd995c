#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "tests/onboard/live/played_devices.hpp"

namespace fathom::test {

// Settings of the program on the vehicle, by its parent.
struct DiveOrders {
  std::filesystem::path folder;   // of the dive
  std::filesystem::path mission;  // that is played
  std::filesystem::path config;   // TOML
  bool hard = false;              // not in soft mode
  std::int64_t shift_ns = 0;      // added to the mission's times gives the vehicle's
  double for_s = 0;               // it ends by itself so long after its map follows; 0: it does not
  std::filesystem::path begun;    // written when it navigates; empty: nothing is
  // Set: so many pairs of the mission, from there on, are flown forward and back without end, from `shift_ns`
  // on.
  std::size_t leg_pairs = 0;
  double from_s = 0;
  rt::VehicleClock::Setting clock{0, 0, 0};  // the vehicle's; rate 0: as the program would have it
};

// What is played to it, from what is due by now.
class DivePlayback {
 public:
  DivePlayback(const DiveOrders& orders, const rt::VehicleClock& clock);
  [[nodiscard]] const Playback& get() const { return *played_; }

 private:
  std::unique_ptr<Shuttle> shuttle_;
  std::unique_ptr<Playback> played_;
};

// Dives live, its devices played at their real rate and its modem a socket, until SIGTERM. On
// stdout a line for everything that the parent wants to know (see DiveLine). Exit status.
int dive(const DiveOrders& orders);

// The socket to the ship, in the child.
constexpr int kModemSocket = 3;

// The lines, one letter and numbers each; monotonic times are the machine's.
//   R away_s first                continues a dive; the first input it is given
//   C checkpoint                  the mapper has begun with it
//   F first                       a dive begins
//   A mono_ns                     armed
//   N mono_ns utc_ns              the hard tier has put inputs in order
//   S mono_ns utc_ns pairs keyframes tiles arrived    after catching up, some times a second
//   B mono_ns pid                 the mapper, that process, follows, after it did not
//   M pairs vehicle mapper heap_calls faults skipped shed state_kib saving_ms   resident now less at arming
//     [KiB]; of the hard tier since arming; pairs shed; the newest saved state, and what the longest took
//   # text                        what the program says
struct DiveMemory {
  std::uint64_t pairs = 0;
  std::int64_t vehicle_kib = 0, mapper_kib = 0;           // grown since arming
  std::uint64_t heap_calls = 0, faults = 0, skipped = 0;  // of the hard tier since then
  std::uint64_t shed = 0;                                 // pairs
  std::uint64_t state_kib = 0;                            // the newest one on the disk
  double saving_ms = 0;                                   // that a state took of the map's work, at most
};
struct DiveState {
  std::int64_t mono_ns = 0, utc_ns = 0;  // utc: of the newest input consumed
  std::uint64_t pairs = 0, keyframes = 0, tiles = 0;
  std::uint64_t arrived = 0;  // frames that the ship acknowledged
};

}  // namespace fathom::test

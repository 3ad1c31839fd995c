#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "realtime/base/units.hpp"
#include "sim/link/channel.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"

namespace fathom::test {

inline constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;
inline constexpr telemetry::LinkIdentity kIdentity{7, 1234};

[[nodiscard]] std::int64_t nanoseconds(double seconds);

// What was drawn.
struct Plan {
  telemetry::LinkSchedulerConfig link;
  sim::ChannelConfig up, down;
  int side = 3;
  double storm_s = 0, step_s = 0.2, change_every_s = 0;
  bool answers = true;
  double ship_from_s = 0;
  std::vector<double> vehicle_restarts, ship_restarts, lost_files, damaged_files;
  bool key = true;
  std::vector<std::pair<double, double>> ship_clock;     // from then on so far ahead of the true time [s]
  std::vector<std::pair<double, double>> vehicle_clock;  // the vehicle's, from a restart on; never set back
  std::vector<std::pair<double, double>> full_disk;      // of the ship, from to [s]
  std::vector<double> requests;                          // from the ship at these times [s]
  bool listener = false;                                 // a second ship that receives and never speaks
};

[[nodiscard]] std::optional<telemetry::LinkKey> keyOf(const Plan& plan);
[[nodiscard]] Plan draw(std::mt19937& random);
[[nodiscard]] std::string describe(const Plan& plan);
// So far is a clock ahead at `now_ns`; see Plan.
[[nodiscard]] std::int64_t aheadAt(const std::vector<std::pair<double, double>>& steps, std::int64_t now_ns);

// How much longer preambles make everything, and padding the ship's turns.
struct Slowness {
  double sending = 1, turns = 1;
};
[[nodiscard]] Slowness slowness(const Plan& plan);

}  // namespace fathom::test

#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// Simulated DVL: sends the schedule's ensembles as PD0 at the rate of a serial line, the last byte of each at
// the time of its arrival in the mission, with the script's garbage and silences.
class DvlPlayer {
 public:
  static constexpr int kBaud = 115200;

  struct Counters {
    std::uint64_t ensembles = 0;     // sent, damaged ones included
    std::uint64_t damaged = 0;       // by dvl_garbage
    std::uint64_t withheld = 0;      // by dvl_silence
    std::int64_t worst_late_ns = 0;  // of the beginning of an ensemble
  };
  // Receiver of the line's bytes.
  using Line = std::function<void(std::span<const std::uint8_t>)>;

  DvlPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
            Line line);

  // Least time from an ensemble's stamp to its first byte at the receiver [s], as stated in a data sheet.
  [[nodiscard]] double latency() const;
  // Plays until the mission's end or `stop`.
  void run(const std::atomic<bool>& stop);
  [[nodiscard]] const Counters& counters() const { return counters_; }  // after run()

 private:
  bool send(std::span<const std::uint8_t> bytes, std::int64_t begin_ns, const std::atomic<bool>& stop);

  const MissionSchedule& schedule_;
  FaultScript script_;
  SimulatedVehicleClock& clock_;
  Line line_;
  Counters counters_;
};

}  // namespace fathom::sim

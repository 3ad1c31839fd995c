#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// Simulated compass, depth sensor, battery, CTD, GPS and mission control on LCM: publishes the schedule's
// samples on the channels of firmware_if/mission/log/log_messages.hpp, each when it is due. It replaces the
// CAN bus; can_bus_off silences it.
class LcmPlayer {
 public:
  struct Counters {
    std::uint64_t messages = 0;  // published
    std::uint64_t withheld = 0;  // by can_bus_off
    std::uint64_t refused = 0;   // by LCM
    std::int64_t worst_late_ns = 0;
  };

  // `provider`: an LCM URL. Throws InputError when LCM cannot use it.
  LcmPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
            const std::string& provider);
  ~LcmPlayer();

  // Plays until the mission's end or `stop`.
  void run(const std::atomic<bool>& stop);
  [[nodiscard]] const Counters& counters() const;  // after run()

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim

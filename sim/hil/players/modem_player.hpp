#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>

#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/vehicle_clock.hpp"
#include "sim/link/simulated_ship.hpp"

namespace fathom::sim {

// The vehicle's modem, the water and the ship in real time: frames that the program hands to its modem travel
// through the simulated channel, the ship answers, and sends the mission's USBL fixes as downlink. What the
// ship hears goes into a file for fathom-monitor --packets.
class ModemPlayer {
 public:
  struct Counters {
    std::uint64_t from_vehicle = 0, to_vehicle = 0;  // frames that crossed the cable
    std::uint64_t silenced = 0;                      // frames lost to modem_silence, either way
    std::uint64_t fixes = 0;                         // measured by the ship
    std::uint64_t broken = 0;                        // frames that the line protocol refused
    SimulatedShip::Summary ship;
  };

  // On a pseudo-terminal with SLIP frames, whose name is the link `port`.
  ModemPlayer(const MissionSchedule& schedule, const FaultScript& script, VehicleClock& clock,
              const std::filesystem::path& heard, const SimulatedShipOptions& water,
              const std::filesystem::path& port);
  // On a UDP port of the loopback; 0 takes a free one, udpPort() says which.
  ModemPlayer(const MissionSchedule& schedule, const FaultScript& script, VehicleClock& clock,
              const std::filesystem::path& heard, const SimulatedShipOptions& water, std::uint16_t udp_port);
  ~ModemPlayer();

  [[nodiscard]] std::uint16_t udpPort() const;
  // All fixes due so far have been said; from any thread.
  [[nodiscard]] bool fixesSaid() const;
  // Until `stop`; then the file of frames heard is whole.
  void run(const std::atomic<bool>& stop);
  [[nodiscard]] Counters counters() const;  // after run()

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim

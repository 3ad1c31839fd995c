#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>

#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"
#include "sim/link/simulated_ship.hpp"

namespace fathom::sim {

// Simulated modem, channel and ship in real time: frames from the program's modem port pass the simulated
// channel; the ship answers and sends the mission's USBL fixes as downlink, and writes the frames that it
// receives to `packet_file`, for fathom-monitor --packets.
class ModemPlayer {
 public:
  struct Counters {
    std::uint64_t from_vehicle = 0, to_vehicle = 0;  // frames that crossed the cable
    std::uint64_t silenced = 0;                      // frames lost by modem_silence, in both directions
    std::uint64_t fixes = 0;                         // measured by the ship
    std::uint64_t broken = 0;                        // frames refused by the line protocol
    SimulatedShip::Summary ship;
  };

  // On a pseudo-terminal with SLIP frames; `port` is a symbolic link to it.
  ModemPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
              const std::filesystem::path& packet_file, const SimulatedShipOptions& water,
              const std::filesystem::path& port);
  // On a UDP port of the loopback; 0: a free one, given by udpPort().
  ModemPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
              const std::filesystem::path& packet_file, const SimulatedShipOptions& water,
              std::uint16_t udp_port);
  ~ModemPlayer();

  [[nodiscard]] std::uint16_t udpPort() const;
  // Whether all fixes due so far have been sent; thread-safe.
  [[nodiscard]] bool fixesSent() const;
  // Plays until `stop`, then completes the packet file.
  void run(const std::atomic<bool>& stop);
  [[nodiscard]] Counters counters() const;  // after run()

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim

#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"
#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// Encodes a DVL sample as a PD0 ensemble (Teledyne RDI, "WorkHorse Commands and Output Data Format", P/N
// 957-6156) with fixed leader, variable leader and bottom track, the inverse of firmware_if/devices/dvl: the
// bottom's velocity in the ship frame (starboard, forward, mast).
//
// The format rounds velocity to 1 mm/s, ranges to 1 cm, speed of sound to 1 m/s and the time to 10 ms.
// Velocities beyond 32.767 m/s are sent as bad.
constexpr std::size_t kPd0FirstBlock = 6 + 2 * 3;  // after header and offsets
// Header, offsets, three blocks, reserve, checksum.
constexpr std::size_t kPd0EncodedBytes = kPd0FirstBlock + 59 + 65 + 81 + 2 + 2;

struct Pd0Attitude {
  double heading = 0;  // [rad]
  double pitch = 0;    // of the vehicle, bow up positive [rad]
  double roll = 0;     // starboard down positive [rad]
};

// `number`: 24 bits of it are sent. Absent ranges stay absent; the receiver derives the altitude from the
// ranges.
[[nodiscard]] std::array<std::uint8_t, kPd0EncodedBytes> encodePd0(const DvlSample& sample,
                                                                   std::uint32_t number,
                                                                   const Pd0Attitude& attitude);

// The time rounded to the resolution of an ensemble, 10 ms.
[[nodiscard]] std::int64_t roundToPd0Clock(std::int64_t utc_ns);

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

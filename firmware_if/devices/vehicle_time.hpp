#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::io {

// The vehicle's time, UTC [ns]: a monotonic clock and an offset fixed when the program was armed, so that a
// step of the system's clock moves no sample. Must not throw and must be callable from any thread.
using VehicleTime = std::function<std::int64_t()>;
// Vehicle time against the system's UTC (rt::clockState), for stamps that others make by UTC. None: no
// difference.
using VehicleClockState = std::function<rt::ClockState()>;

// Turns receive times by the system's clock into vehicle time. The kernel stamps CAN frames, and Aravis
// images, with CLOCK_REALTIME, which may be stepped; vehicle time never steps. A frame's age is the distance
// of its stamp from the present by the system's clock: as it is now or, where that gives no possible age, as
// it was when the queue was last empty; where neither does, the frame came at present. Each step is counted.
class ReceiveTime {
 public:
  // Time of a frame in vehicle time [ns]; `system_ns` and `vehicle_ns`: both clocks, read just now.
  [[nodiscard]] std::int64_t toVehicle(std::int64_t stamp_system_ns, std::int64_t system_ns,
                                       std::int64_t vehicle_ns) noexcept;
  // To be called whenever no frame is waiting: later frames are stamped by the system's clock as it is now.
  void drained(std::int64_t system_ns, std::int64_t vehicle_ns) noexcept;

  [[nodiscard]] std::uint64_t clockSteps() const noexcept { return steps_; }

 private:
  std::optional<std::int64_t> offset_ns_;  // system minus vehicle time, when the queue was last empty
  std::int64_t drained_ns_ = 0;            // vehicle time of that
  std::uint64_t steps_ = 0;
};

}  // namespace fathom::io

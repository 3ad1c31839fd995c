#pragma once

#include <cstdint>
#include <optional>

namespace fathom::io {

// The kernel stamps CAN frames, and Aravis images, with CLOCK_REALTIME, which somebody may step; vehicle time
// never steps. A frame's age is its stamp's distance from the present, by the system clock as it was when the
// frame came: where that clock was stepped since the queue was last empty, the reading that makes sense is
// taken, and if none does, the present. Each step is counted.
class ReceiveTime {
 public:
  // Time of a frame in vehicle time [ns]; the present in both clocks, read just now.
  [[nodiscard]] std::int64_t toVehicle(std::int64_t stamp_system_ns, std::int64_t system_ns,
                                       std::int64_t vehicle_ns) noexcept;
  // To be told whenever no frame is waiting: what comes next comes by the system clock as it is now.
  void drained(std::int64_t system_ns, std::int64_t vehicle_ns) noexcept;

  [[nodiscard]] std::uint64_t clockSteps() const noexcept { return steps_; }

 private:
  std::optional<std::int64_t> offset_ns_;  // system minus vehicle time, when the queue was last empty
  std::int64_t drained_ns_ = 0;            // vehicle time of that
  std::uint64_t steps_ = 0;
};

}  // namespace fathom::io

#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "realtime/kernel/time/clock_line.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::io {

// Turns the stamps of a device's own clock into vehicle time by when its messages arrive. The delay from
// stamp to arrival is at least the stated latency; the least of arrival less stamp over a few messages
// therefore measures offset and drift of the clock. A line is fitted to the least differences of the last
// windows; delays of the serial line and the scheduler, which are never negative, drop out. Clock filters of
// this kind: Mills, RFC 5905, section 10.
//
// A step of the clock shows as a message earlier than the line by over `leap_s`, or all later than that:
// the first resets the line at once, the second after kLateAlike in a row. Until then a late message
// counts as delayed: its stamp is used or, if it is late by more than `held_up_s`, its arrival less
// `latency_s`. Fixed memory; same calls, same result.
class DeviceClock {
 public:
  struct Config {
    double latency_s = 0;      // least time from the stamp to the arrival, as the device's manual has it
    double resolution_s = 0;   // of the stamps, which the device truncates: half of it is added
    double leap_s = 0.25;      // residual beyond which the clock stepped or the message was delayed
    double held_up_s = 1;      // longest delay by serial line and scheduler
    double max_rate = 500e-6;  // of a quartz against the vehicle's, with margin [s/s]
  };
  explicit DeviceClock(const Config& config) : config_(config) {}

  // The stamp in the vehicle's time, never after `arrival_ns` (vehicle time). Messages come in their order.
  [[nodiscard]] std::int64_t vehicleNs(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;
  // The device started again: forgets its clock.
  void restart() noexcept;

  // What must be added to the device's time to get the vehicle's, at the last stamp [s]; how fast it grows
  // [s/s]. 0 before the first message.
  [[nodiscard]] double offset() const noexcept { return static_cast<double>(offset_ns_) / 1e9; }
  [[nodiscard]] double rate() const noexcept { return line_.rate(); }
  // Counts: steps of the clock; messages later than `leap_s` that did not make a step.
  [[nodiscard]] std::uint64_t leaps() const noexcept { return leaps_; }
  [[nodiscard]] std::uint64_t late() const noexcept { return late_; }

 private:
  static constexpr double kWindow = 5;       // of the device's time, that gives one least difference [s]
  static constexpr std::size_t kFewest = 6;  // windows before the line may have a slope: half a minute
  static constexpr int kLateAlike = 5;       // late messages in a row that count as a step
  void begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;

  Config config_;
  bool any_ = false;
  std::int64_t first_stamp_ns_ = 0, base_ns_ = 0, offset_ns_ = 0;
  rt::ClockPoint least_;  // arrival less stamp, of the open window
  double window_begin_ = 0;
  rt::ClockLine line_;
  int late_in_row_ = 0;
  double late_delay_ = 0;  // of the last message that came too late [s]
  std::uint64_t leaps_ = 0, late_ = 0;
};

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

#pragma once

#include <cstdint>

#include "realtime/kernel/clock_line.hpp"

namespace fathom::io {

// Turns the stamps of a device's own clock into vehicle time by when its messages arrive. A message arrives a
// delay after its stamp that is never less than some least one, the stated latency; so the least of arrival
// less stamp over a few messages tells offset and drift of the clock. A line is fitted to the least
// differences of the last windows; the noise of a serial line and of the scheduler, which only ever delays,
// falls out. Clock filters of this kind: Mills, RFC 5905, section 10.
//
// A clock that is set anew shows as messages that arrive before their stamp's time, or all too late from then
// on; the first are believed at once, the second after a few alike. Until then a message that comes too late
// was held up: its stamp counts, unless no line holds a message up for so long; then its arrival does. Fixed
// memory; same calls, same result.
class DeviceClock {
 public:
  struct Config {
    double latency_s = 0;      // least time from the stamp to the arrival, as the device's manual has it
    double resolution_s = 0;   // of the stamps, which are cut to it: half of it is added
    double leap_s = 0.25;      // off the line by more: the clock leapt, or the message was held up
    double held_up_s = 1;      // no message is held up for longer
    double max_rate = 500e-6;  // of a quartz against the vehicle's, with margin [s/s]
  };
  explicit DeviceClock(const Config& config) : config_(config) {}

  // The stamp in the vehicle's time, never after `arrival_ns` (vehicle time). Messages come in their order.
  [[nodiscard]] std::int64_t vehicleNs(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;
  // Forgets what the clock did: the device started again.
  void restart() noexcept;

  // What must be added to the device's time to get the vehicle's, at the last stamp [s]; how fast it grows
  // [s/s]. 0 before the first message.
  [[nodiscard]] double offset() const noexcept { return static_cast<double>(offset_ns_) / 1e9; }
  [[nodiscard]] double rate() const noexcept { return line_.rate(); }
  // Times that the clock was set anew, and messages that came too late.
  [[nodiscard]] std::uint64_t leaps() const noexcept { return leaps_; }
  [[nodiscard]] std::uint64_t late() const noexcept { return late_; }

 private:
  static constexpr double kWindow = 5;       // of the device's time, that gives one least difference [s]
  static constexpr std::size_t kFewest = 6;  // windows before the line may have a slope: half a minute
  static constexpr int kLateAlike = 5;       // messages that make a leap
  void begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept;

  Config config_;
  bool any_ = false;
  std::int64_t first_stamp_ns_ = 0, base_ns_ = 0, offset_ns_ = 0;
  rt::ClockPoint least_;  // arrival less stamp, of the window under way
  double window_begin_ = 0;
  rt::ClockLine line_;
  int late_in_row_ = 0;
  double late_delay_ = 0;  // of the last message that came too late [s]
  std::uint64_t leaps_ = 0, late_ = 0;
};

}  // namespace fathom::io

#pragma once

#include <cstdint>

namespace fathom::rt {

// Source of time for programs and loops. The cores never use one: they take time from their inputs.
class Clock {
 public:
  virtual ~Clock() = default;
  // Time since some fixed moment; never goes back and never jumps [ns].
  [[nodiscard]] virtual std::int64_t monotonicNs() const noexcept = 0;
  // Since the Unix epoch, UTC; may be stepped when the vehicle's clock is set [ns].
  [[nodiscard]] virtual std::int64_t utcNs() const noexcept = 0;
  // Returns once monotonicNs() >= `monotonic_ns`; at once when that is past.
  virtual void sleepUntil(std::int64_t monotonic_ns) noexcept = 0;
};

// CLOCK_MONOTONIC and CLOCK_REALTIME; sleeps with clock_nanosleep to an absolute time, so that errors never
// add up.
class RealClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t monotonicNs() const noexcept override;
  [[nodiscard]] std::int64_t utcNs() const noexcept override;
  void sleepUntil(std::int64_t monotonic_ns) noexcept override;
};

// State of the system's clock according to the kernel (man 2 adjtimex).
struct SystemClockState {
  bool known = false;         // false: the system gives no state
  bool synchronised = false;  // disciplined by chrony, ntpd or ptp4l
  bool pps = false;           // by a pulse a second
  double error_s = 0;         // largest error, as stated by the discipline [s]
};
[[nodiscard]] SystemClockState readSystemClock() noexcept;

}  // namespace fathom::rt

#pragma once

#include <cstdint>

namespace fathom::rt {

// Where the time comes from. Programs and loops ask a Clock; the cores never do, they take time from their
// inputs.
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

}  // namespace fathom::rt

#pragma once

#include <atomic>
#include <cstdint>

namespace fathom::rt {

// Where the time comes from: the machine, or a log that is being replayed. Programs and loops ask a Clock; the
// cores never do, they take time from their inputs.
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

// Time as the log says. Nothing waits: sleeping moves the time on. One thread sets it, any thread may read
// it.
class ReplayedClock final : public Clock {
 public:
  explicit ReplayedClock(std::int64_t utc_ns = 0) noexcept : utc_ns_(utc_ns) {}

  // Time of the log entry about to be replayed. Where the log's UTC steps back, monotonic time stands still.
  void setUtc(std::int64_t utc_ns) noexcept;
  // Time passes, in both clocks: work that takes `duration_ns` (>= 0).
  void advance(std::int64_t duration_ns) noexcept;

  [[nodiscard]] std::int64_t monotonicNs() const noexcept override {
    return monotonic_ns_.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::int64_t utcNs() const noexcept override {
    return utc_ns_.load(std::memory_order_acquire);
  }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override;

 private:
  std::atomic<std::int64_t> monotonic_ns_{0};
  std::atomic<std::int64_t> utc_ns_;
};

}  // namespace fathom::rt

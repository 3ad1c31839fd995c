#pragma once

#include <algorithm>
#include <cstdint>

#include "realtime/base/numbers/log_histogram.hpp"

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

// Runs a body at a fixed rate on absolute deadlines (first deadline: one period after construction) and
// measures itself. If a body runs past the next deadlines, these are skipped and counted, and the phase is
// kept, so that lateness never accumulates.
class PeriodicLoop {
 public:
  struct Statistics {
    std::uint64_t cycles = 0;
    std::uint64_t skipped_cycles = 0;  // deadlines skipped because the body was still running
    std::int64_t max_body_ns = 0;
    LogHistogram body_ns;    // time the body took
    LogHistogram jitter_ns;  // how late after its deadline a cycle began
  };

  // `period_ns` > 0; the clock must outlive the loop.
  PeriodicLoop(Clock& clock, std::int64_t period_ns) noexcept;

  // Sleeps until the next deadline, runs body() once, measures.
  template <typename Body>
  void runOnce(Body&& body) noexcept(noexcept(body())) {
    clock_.sleepUntil(deadline_ns_);
    const std::int64_t begin = clock_.monotonicNs();
    body();
    finish(begin, clock_.monotonicNs());
  }

  // Cycles until body() returns false.
  template <typename Body>
  void run(Body&& body) noexcept(noexcept(body())) {
    bool more = true;
    while (more) runOnce([&]() noexcept(noexcept(body())) { more = body(); });
  }

  [[nodiscard]] std::int64_t periodNs() const noexcept { return period_ns_; }
  [[nodiscard]] std::int64_t nextDeadlineNs() const noexcept { return deadline_ns_; }  // monotonic
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  void finish(std::int64_t begin_ns, std::int64_t end_ns) noexcept;

  Clock& clock_;
  std::int64_t period_ns_;
  std::int64_t deadline_ns_;
  Statistics statistics_;
};

// Exponential back-off: the wait before the next try is `first_ns` after the first failure and doubles with
// each further one, up to `longest_ns`. Any clock that does not run backwards.
class RetryWait {
 public:
  constexpr RetryWait(std::int64_t first_ns, std::int64_t longest_ns) noexcept
      : first_ns_(first_ns), longest_ns_(longest_ns), wait_ns_(first_ns) {}

  // Whether it may be tried; true before any failure.
  [[nodiscard]] bool due(std::int64_t now_ns) const noexcept { return now_ns >= next_ns_; }
  void failed(std::int64_t now_ns) noexcept {
    next_ns_ = now_ns + wait_ns_;
    wait_ns_ = std::min(2 * wait_ns_, longest_ns_);
  }
  void succeeded() noexcept {
    wait_ns_ = first_ns_;
    next_ns_ = INT64_MIN;
  }

 private:
  std::int64_t first_ns_, longest_ns_, wait_ns_;
  std::int64_t next_ns_ = INT64_MIN;
};

}  // namespace fathom::rt

#pragma once

#include <cstdint>

#include "realtime/base/numbers/log_histogram.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::rt {

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

}  // namespace fathom::rt

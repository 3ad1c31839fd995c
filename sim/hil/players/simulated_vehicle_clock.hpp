#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

#include "realtime/kernel/time/clock.hpp"

namespace fathom::sim {

// Vehicle time of the bench: UTC at its start, continued by the monotonic clock, so that a step of the
// system's clock shifts no device.
class SimulatedVehicleClock {
 public:
  explicit SimulatedVehicleClock(rt::Clock& clock)
      : clock_(clock), offset_ns_(clock.utcNs() - clock.monotonicNs()) {}

  [[nodiscard]] std::int64_t utcNs() const { return clock_.monotonicNs() + offset_ns_; }
  // Sleeps until then; false within 100 ms of `stop`.
  bool sleepUntil(std::int64_t utc_ns, const std::atomic<bool>& stop) {
    constexpr std::int64_t kPollNs = 100'000'000;
    while (!stop.load(std::memory_order_relaxed)) {
      const std::int64_t now_ns = utcNs();
      if (now_ns >= utc_ns) return true;
      clock_.sleepUntil(std::min(utc_ns, now_ns + kPollNs) - offset_ns_);
    }
    return false;
  }

 private:
  rt::Clock& clock_;
  std::int64_t offset_ns_;
};

}  // namespace fathom::sim

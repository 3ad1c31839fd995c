#pragma once

#include <cstdint>

#include "realtime/kernel/clock.hpp"

namespace fathom::rt {

// The vehicle's time: the monotonic clock and an offset to UTC that is fixed when the program arms, and kept
// when it starts again on the same machine. Whoever sets the system's clock during a dive moves no sample.
class VehicleClock final : public Clock {
 public:
  // UTC less the monotonic clock [ns]. `rate`: seconds of both clocks in one of the machine's, for tests that
  // play a mission faster; 1 on a vehicle.
  explicit VehicleClock(std::int64_t offset_ns, double rate = 1) noexcept
      : offset_ns_(offset_ns), rate_(rate), begin_ns_(clock_.monotonicNs()) {}
  [[nodiscard]] static std::int64_t systemOffsetNs() noexcept {
    const RealClock clock;
    return clock.utcNs() - clock.monotonicNs();
  }

  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return scaled(clock_.monotonicNs()); }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return monotonicNs() + offset_ns_; }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override {
    if (rate_ != 1)
      monotonic_ns =
          begin_ns_ + static_cast<std::int64_t>(static_cast<double>(monotonic_ns - begin_ns_) / rate_);
    clock_.sleepUntil(monotonic_ns);
  }
  // By how much the system's clock has been set since the offset was taken [ns].
  [[nodiscard]] std::int64_t systemStepNs() const noexcept {
    return rate_ == 1 ? systemOffsetNs() - offset_ns_ : 0;
  }

 private:
  [[nodiscard]] std::int64_t scaled(std::int64_t machine_ns) const noexcept {
    if (rate_ == 1) return machine_ns;
    return begin_ns_ + static_cast<std::int64_t>(static_cast<double>(machine_ns - begin_ns_) * rate_);
  }

  RealClock clock_;
  std::int64_t offset_ns_;
  double rate_;
  std::int64_t begin_ns_;  // of the machine's clock
};

}  // namespace fathom::rt

#pragma once

#include <atomic>

#include "realtime/kernel/time/clock.hpp"

namespace fathom::test {

// Nothing waits: sleeping moves the time on. One thread does so, any thread may read it.
class ManualClock final : public rt::Clock {
 public:
  explicit ManualClock(std::int64_t utc_ns = 0) noexcept : offset_ns_(utc_ns) {}

  void advance(std::int64_t duration_ns) noexcept { monotonic_ns_ += duration_ns; }

  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return monotonic_ns_; }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return monotonic_ns_ + offset_ns_; }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override {
    if (monotonic_ns > monotonic_ns_) monotonic_ns_ = monotonic_ns;
  }

 private:
  std::atomic<std::int64_t> monotonic_ns_{0};
  std::int64_t offset_ns_;
};

}  // namespace fathom::test

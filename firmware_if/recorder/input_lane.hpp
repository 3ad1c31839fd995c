#pragma once

#include <atomic>
#include <cstdint>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {

struct InputLaneEntry {
  std::uint64_t number = 0;     // of all that were offered
  std::int64_t offered_ns = 0;  // monotonic
  OnboardInput input;
};

// Inputs that wait for the log. All are numbered when they are offered, also those that find no room, so that
// the recorder finds where some are missing.
class InputLane {
 public:
  using Entry = InputLaneEntry;
  static constexpr std::size_t kCapacity = 4096;  // half a minute of every sensor at its full rate

  // Producer only; wait-free.
  [[nodiscard]] bool offer(const OnboardInput& input) noexcept {
    offered_.number = number_.load(std::memory_order_relaxed);
    number_.store(offered_.number + 1, std::memory_order_relaxed);
    offered_.offered_ns = clock_.monotonicNs();
    offered_.input = input;
    return ring_.push(offered_);
  }

  // Consumer only: the oldest entry, or nullptr.
  [[nodiscard]] const Entry* front() noexcept {
    if (!held_) held_ = ring_.pop(front_);
    return held_ ? &front_ : nullptr;
  }
  // Consumer only, after front() gave one: how many were refused just before it; and on to the next.
  [[nodiscard]] std::uint64_t missingBeforeFront() const noexcept { return front_.number - next_; }
  void pop() noexcept {
    held_ = false;
    next_ = front_.number + 1;
  }
  // Number of the next that is to come: all before it were popped, or refused.
  [[nodiscard]] std::uint64_t next() const noexcept { return next_; }
  // After the producer has ended, when front() gives none: how many were refused behind the last one; and on
  // behind them.
  [[nodiscard]] std::uint64_t missingAtEnd() const noexcept {
    return number_.load(std::memory_order_relaxed) - next_;
  }
  void passOverEnd() noexcept { next_ = number_.load(std::memory_order_relaxed); }

  [[nodiscard]] std::uint64_t refused() const noexcept { return ring_.refused(); }
  [[nodiscard]] std::size_t highWater() const noexcept { return ring_.highWater(); }

 private:
  rt::RealClock clock_;
  rt::SpscRing<Entry, kCapacity> ring_;
  alignas(rt::kCacheLine) Entry offered_;  // the producer's
  std::atomic<std::uint64_t> number_{0};
  alignas(rt::kCacheLine) Entry front_;  // the consumer's
  std::uint64_t next_ = 0;
  bool held_ = false;
};

}  // namespace fathom::io

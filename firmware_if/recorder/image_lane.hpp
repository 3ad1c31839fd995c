#pragma once

#include <cstdint>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::io {

// One camera's exposures that wait for the disk, and the outcome of those that no input has named yet.
class ImageLane {
 public:
  static constexpr std::size_t kCapacity = 64;

  explicit ImageLane(std::size_t most_waiting) : most_waiting_(most_waiting) {}

  // Producer only; wait-free. False when too many wait.
  [[nodiscard]] bool offer(const CameraFrame& frame) noexcept {
    if (ring_.used() < most_waiting_ && ring_.push(frame)) return true;
    refused_.store(refused_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    return false;
  }

  // The rest: consumer only.
  [[nodiscard]] bool waiting() const noexcept { return ring_.used() > 0; }
  [[nodiscard]] bool take(CameraFrame& frame) noexcept { return ring_.pop(frame); }
  // Remembers what became of a frame; true when that pushed out one that no input named.
  bool settle(std::int64_t utc_ns, bool written) noexcept {
    return settled_.pushDroppingOldest({utc_ns, written});
  }

  enum class State : std::uint8_t { kWritten, kLost, kWaiting };
  // Of the exposure that an input names. Frames settled before it are left behind: no input named them.
  [[nodiscard]] State stateOf(std::int64_t utc_ns) const noexcept {
    for (std::size_t i = 0; i < settled_.size(); ++i)
      if (settled_[i].utc_ns == utc_ns) return settled_[i].written ? State::kWritten : State::kLost;
    return waiting() ? State::kWaiting : State::kLost;
  }
  // Forgets it and those before; gives how many of these were written without an input.
  std::uint64_t forget(std::int64_t utc_ns) noexcept {
    std::uint64_t unnamed = 0;
    for (std::size_t i = 0; i < settled_.size(); ++i) {
      if (settled_[i].utc_ns != utc_ns) continue;
      for (std::size_t before = 0; before < i; ++before) unnamed += settled_[before].written ? 1 : 0;
      for (std::size_t gone = 0; gone <= i; ++gone) settled_.popFront();
      break;
    }
    return unnamed;
  }

  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t highWater() const noexcept { return ring_.highWater(); }

 private:
  struct Settled {
    std::int64_t utc_ns = 0;
    bool written = false;
  };
  std::size_t most_waiting_;
  rt::SpscRing<CameraFrame, kCapacity> ring_;
  std::atomic<std::uint64_t> refused_{0};
  rt::FixedQueue<Settled, kCapacity> settled_;  // oldest first
};

}  // namespace fathom::io

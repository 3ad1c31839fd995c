#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/vehicle_clock.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/live/soft_tier.hpp"
#include "realtime/onboard/live/watched_threads.hpp"

namespace fathom::onboard {

// Looks after a live run some times a second: threads, the system's clock, when a checkpoint is due, and the
// health flags that the cores cannot see.
class Supervisor {
 public:
  struct Links {
    WatchedThreads* threads = nullptr;
    HardTier* hard = nullptr;
    const SoftTier* soft = nullptr;
    const io::Recorder* recorder = nullptr;
    const rt::VehicleClock* clock = nullptr;
  };
  Supervisor(const Links& links, double checkpoint_s, std::uint64_t next_checkpoint)
      : links_(links),
        checkpoint_ns_(static_cast<std::int64_t>(checkpoint_s * 1e9)),
        next_(next_checkpoint) {}

  // When armed; whether with all that real time needs.
  void begin(bool complete);
  // A line for each thing that happened. `slipped`: cycles of the hard loop, so far.
  [[nodiscard]] std::vector<std::string> step(std::uint64_t slipped);
  // From any thread.
  [[nodiscard]] std::uint64_t clockSteps() const { return clock_steps_.load(std::memory_order_relaxed); }

 private:
  [[nodiscard]] std::uint64_t programHealth(std::uint64_t slipped) const;

  Links links_;
  std::int64_t checkpoint_ns_;
  std::uint64_t next_;  // checkpoint
  std::int64_t next_checkpoint_ns_ = 0, last_step_ns_ = 0;
  bool complete_ = false;
  std::uint64_t told_health_ = 0;
  std::atomic<std::uint64_t> clock_steps_{0};
};

}  // namespace fathom::onboard

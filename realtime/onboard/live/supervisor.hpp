#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/live/devices/device_threads.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/live/watched_threads.hpp"
#include "realtime/onboard/mapper/mapper_keeper.hpp"

namespace fathom::onboard {

// Supervises a live run some times a second: threads, the mapper process, the system's clock, due
// checkpoints, the state of every part, and the health flags that the cores cannot see.
class Supervisor {
 public:
  struct Links {
    WatchedThreads* threads = nullptr;
    HardTier* hard = nullptr;
    const io::Recorder* recorder = nullptr;
    const rt::VehicleClock* clock = nullptr;
    MapperChannel* channel = nullptr;
    MapperChild* child = nullptr;
    OwnStatus* own_status = nullptr;
    PartStates* parts = nullptr;
    std::function<std::vector<io::DeviceHealth>()> devices;
  };
  Supervisor(const Links& links, const MapperKeeper::Config& keeper, double checkpoint_s,
             std::uint64_t next_checkpoint)
      : links_(links),
        checkpoint_ns_(static_cast<std::int64_t>(checkpoint_s * 1e9)),
        next_(next_checkpoint),
        keeper_(keeper) {}

  // When armed. `complete`: with all that real time needs.
  void begin(bool complete);
  // Returns a line per event. `skipped`: cycles of the hard loop, so far.
  [[nodiscard]] std::vector<std::string> step(std::uint64_t skipped);
  // Only the mapper: before it is armed, and when the rest has ended.
  void stepMapper(std::vector<std::string>& events);
  // A state is to be saved now, whether or not one is due.
  void askForCheckpoint() { next_checkpoint_ns_ = 0; }
  // The mapper is not started again.
  void stopRestarts() { restarts_stopped_ = true; }

  // From any thread.
  [[nodiscard]] std::uint64_t clockSteps() const { return clock_steps_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t mapperStarts() const { return starts_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t mapperRestarts() const {
    const std::uint64_t starts = mapperStarts();
    return starts > 0 ? starts - 1 : 0;
  }
  // By the thread that calls step().
  [[nodiscard]] MapperPhase phase() const;
  [[nodiscard]] bool mapperDone() const { return keeper_.done(); }

 private:
  [[nodiscard]] std::uint64_t programHealth(std::uint64_t skipped) const;
  [[nodiscard]] MapperKeeper::Seen look() const;
  void startMapper(bool from_empty, std::vector<std::string>& events);
  void dropPair(std::uint32_t pair);
  // Logs the mark of the mapper's start, when it has nearly caught up.
  void markRestart(std::vector<std::string>& events);
  [[nodiscard]] std::string refusalOf(const std::string& part) const;
  void notePartStates(std::vector<std::string>& events);

  Links links_;
  std::int64_t checkpoint_ns_;
  std::uint64_t next_;  // checkpoint
  MapperKeeper keeper_;
  std::int64_t next_checkpoint_ns_ = 0, last_step_ns_ = 0;
  bool complete_ = false, restarts_stopped_ = false, begun_ = false;
  bool restart_marked_ = false, lost_marked_ = true;
  std::int64_t mapper_started_ns_ = 0;
  std::string mapper_reason_ = "not started yet";
  std::uint64_t reported_health_ = 0;
  rt::ClockHealth clock_health_;
  std::atomic<std::uint64_t> clock_steps_{0}, starts_{0};
};

}  // namespace fathom::onboard

#include "realtime/kernel/threads/realtime_config.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

constexpr int kHighestFifo = 98;  // 99 is the kernel's own: migration and watchdog threads
constexpr int kMaxCpus = 1024;
constexpr std::int64_t kKib = 1024, kLeastStack = 64, kMostStack = 16384;

}  // namespace

void visitRealtime(KeyVisitor& keys, RealtimeConfig& c) {
  keys.boolean("soft", c.soft, "continue without what the system refuses, and report it");
  keys.scaledNumber("period_ms", c.period_ns, kMillisecond_ns, "ms", 1, 1000, "of the hard loop");
  keys.integer("hard_priority", c.hard_priority, 1, kHighestFifo, "SCHED_FIFO of the hard loop");
  keys.integer("device_priority", c.device_priority, 0, kHighestFifo,
               "of the threads that read devices; 0: best effort");
  keys.integer("camera_priority", c.camera_priority, 0, kHighestFifo, "of the cameras' threads");
  keys.integer("soft_priority", c.soft_priority, 0, kHighestFifo,
               "of vision, below the hard loop's; 0: best effort");
  keys.integer("best_effort_nice", c.best_effort_nice, 0, 19, "of the rest");
  keys.integers("hard_cpus", c.hard_cpus, 0, kMaxCpus - 1,
                "of the hard loop, devices and cameras; empty: any");
  keys.integers("soft_cpus", c.soft_cpus, 0, kMaxCpus - 1, "of vision");
  keys.integers("best_effort_cpus", c.best_effort_cpus, 0, kMaxCpus - 1, "of the rest");
  keys.scaled("stack_kib", c.stack_bytes, kKib, "KiB", kLeastStack, kMostStack, "of a tier's thread");
  keys.scaled("library_stack_kib", c.library_stack_bytes, kKib, "KiB", kLeastStack, kMostStack,
              "of threads that libraries start");
  keys.scaledNumber("stuck_after_s", c.stuck_after_ns, kSecond_ns, "s", 0.1, 60,
                    "a tier without a heartbeat for so long is stuck");
  keys.integer("cpu_wake_us", c.cpu_wake_us, "us", -1, 1'000'000,
               "idle states that take longer to leave are not entered; -1: as the machine does");
  keys.number("end_within_s", c.end_within_s, "s", 5, 3600,
              "that the end of a dive may take in all; the unit's TimeoutStopSec is above it");
  keys.require(c.soft_priority < c.hard_priority, "soft_priority",
               "must be below hard_priority: vision would hold up navigation");
}

ThreadConfig threadConfig(const RealtimeConfig& config, Tier tier, std::string name) {
  ThreadConfig thread;
  thread.name = std::move(name);
  thread.stack_bytes = config.stack_bytes;
  switch (tier) {
    case Tier::kHard:
      thread.fifo_priority = config.hard_priority;
      thread.cpus = config.hard_cpus;
      break;
    case Tier::kDevice:
      thread.fifo_priority = config.device_priority;
      thread.cpus = config.hard_cpus;
      break;
    case Tier::kCamera:
      thread.fifo_priority = config.camera_priority;
      thread.cpus = config.hard_cpus;
      break;
    case Tier::kSoft:
      thread.fifo_priority = config.soft_priority;
      thread.cpus = config.soft_cpus;
      break;
    case Tier::kBestEffort:
      thread.nice = config.best_effort_nice;
      thread.cpus = config.best_effort_cpus;
      break;
  }
  return thread;
}

int highestPriority(const RealtimeConfig& config) {
  return std::max(
      {config.hard_priority, config.device_priority, config.camera_priority, config.soft_priority});
}

}  // namespace fathom::rt

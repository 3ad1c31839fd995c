#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "realtime/base/config_keys.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"

namespace fathom::rt {

// `[realtime]` of a program's configuration.
struct RealtimeConfig {
  bool soft = false;                    // continue without what the system refuses, and report it
  std::int64_t period_ns = 10'000'000;  // of the hard loop
  int hard_priority = 80;               // SCHED_FIFO
  int device_priority = 70;             // of the threads that read devices
  int camera_priority = 60;
  int soft_priority = 20;  // of vision; 0: best effort
  int best_effort_nice = 5;
  std::vector<int> hard_cpus;  // also of devices and cameras; empty: any
  std::vector<int> soft_cpus, best_effort_cpus;
  std::size_t stack_bytes = 1024 * 1024;          // of a tier's thread
  std::size_t library_stack_bytes = 1024 * 1024;  // of a thread that a library starts
  std::int64_t stuck_after_ns = 2'000'000'000;    // a tier without a heartbeat for so long is stuck
  double end_within_s = 150;                      // that the end of a dive may take in all
  int cpu_wake_us = 10;                           // CPUs leave idle so fast at least; -1: as the machine does
};

enum class Tier : std::uint8_t { kHard, kDevice, kCamera, kSoft, kBestEffort };

void visitRealtime(KeyVisitor& keys, RealtimeConfig& config);

// What a thread of `tier` runs with.
[[nodiscard]] ThreadConfig threadConfig(const RealtimeConfig& config, Tier tier, std::string name);

// The highest priority that any tier asks for.
[[nodiscard]] int highestPriority(const RealtimeConfig& config);

}  // namespace fathom::rt

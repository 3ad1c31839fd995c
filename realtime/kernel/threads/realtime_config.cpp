#include "realtime/kernel/threads/realtime_config.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::rt {
namespace {

constexpr int kHighestFifo = 98;  // 99 is the kernel's own: migration and watchdog threads
constexpr double kMaxCpus = 1024;
constexpr std::int64_t kKib = 1024;

int priority(const ConfigTable& table, const char* key, int fallback, int min) {
  return static_cast<int>(table.integer(key, fallback, min, kHighestFifo));
}

std::vector<int> cpus(const ConfigTable& table, const char* key, const std::vector<int>& fallback) {
  const std::vector<double> defaults(fallback.begin(), fallback.end());
  std::vector<int> result;
  for (const double cpu : table.numbers(key, defaults, 0, 0, kMaxCpus - 1)) {
    if (cpu != std::floor(cpu)) table.fail(key, "must be an array of whole numbers");
    result.push_back(static_cast<int>(cpu));
  }
  return result;
}

std::size_t kib(const ConfigTable& table, const char* key, std::size_t fallback) {
  constexpr std::int64_t kSmallest = 64, kLargest = 16384;
  return static_cast<std::size_t>(
      table.integer(key, static_cast<std::int64_t>(fallback) / kKib, kSmallest, kLargest) * kKib);
}

}  // namespace

RealtimeConfig readRealtimeConfig(const ConfigTable& table, RealtimeConfig defaults) {
  RealtimeConfig c = std::move(defaults);
  const auto period_ms = static_cast<double>(c.period_ns) / kNanosecondsPerMillisecond;
  const auto stuck_s = static_cast<double>(c.stuck_after_ns) / kNanosecondsPerSecond;
  c.soft = table.boolean("soft", c.soft);
  c.period_ns = std::llround(table.number("period_ms", period_ms, 1, 1000) * kNanosecondsPerMillisecond);
  c.hard_priority = priority(table, "hard_priority", c.hard_priority, 1);
  c.device_priority = priority(table, "device_priority", c.device_priority, 0);
  c.camera_priority = priority(table, "camera_priority", c.camera_priority, 0);
  c.soft_priority = priority(table, "soft_priority", c.soft_priority, 0);
  c.best_effort_nice = static_cast<int>(table.integer("best_effort_nice", c.best_effort_nice, 0, 19));
  c.hard_cpus = cpus(table, "hard_cpus", c.hard_cpus);
  c.soft_cpus = cpus(table, "soft_cpus", c.soft_cpus);
  c.best_effort_cpus = cpus(table, "best_effort_cpus", c.best_effort_cpus);
  c.stack_bytes = kib(table, "stack_kib", c.stack_bytes);
  c.library_stack_bytes = kib(table, "library_stack_kib", c.library_stack_bytes);
  c.stuck_after_ns = std::llround(table.number("stuck_after_s", stuck_s, 0.1, 60) * kNanosecondsPerSecond);
  c.cpu_wake_us = static_cast<int>(table.integer("cpu_wake_us", c.cpu_wake_us, -1, 1'000'000));
  if (c.soft_priority >= c.hard_priority)
    table.fail("soft_priority", "must be below hard_priority: vision would hold up navigation");
  return c;
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

#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"

namespace fathom::rt {

// One thing that real time needs from the machine.
struct ArmingCheck {
  std::string name;  // "SCHED_FIFO", "locked memory"
  bool ok = true;
  bool required = true;  // false: informative only, never prevents arming
  std::string found;     // what the machine says
  std::string missing;   // what is wrong; "" when ok
  std::string grant;     // what a systemd unit must say, or what else helps; "" when ok
};

struct ArmingResult {
  std::vector<ArmingCheck> checks;
  bool soft = false;  // what is missing was overridden

  [[nodiscard]] bool complete() const noexcept;  // nothing required is missing
  [[nodiscard]] bool armed() const noexcept { return complete() || soft; }
  // Names of what is missing, as "SCHED_FIFO, locked memory"; "" when complete. For every status of a program
  // that runs in soft mode.
  [[nodiscard]] std::string missingNames() const;
  // For the operator, several lines: a line each of what is missing and of what grants it. "" when complete.
  [[nodiscard]] std::string message() const;
  // Every check, a line each, "ok" or "MISSING" first.
  [[nodiscard]] std::string table() const;
};

// Checks what the machine grants, without changing anything (a short-lived thread tries the priorities).
[[nodiscard]] ArmingResult checkArming(const RealtimeConfig& realtime, const MemoryBudget& budget);

// The same checks, then locks all memory of the process, present and future (mlockall); where that is
// refused, makes the present pages resident. The last step before the loop begins: every pool is made, the
// heap is reserved (`heap`), and every thread is started.
[[nodiscard]] ArmingResult arm(const RealtimeConfig& realtime, const MemoryBudget& budget, HeapReserve& heap,
                               std::size_t heap_bytes);

// Keeps the machine's CPUs out of idle states that take longer than a limit to leave, while it lives
// (/dev/cpu_dma_latency). A 100 Hz loop wakes from idle each time; 0 allows no idle state at all and costs a
// battery some watts, 10 us allows the shallow ones.
class CpuWakeLimit {
 public:
  // [us]; negative: leaves the machine as it is.
  explicit CpuWakeLimit(int microseconds) noexcept;
  ~CpuWakeLimit();
  CpuWakeLimit(const CpuWakeLimit&) = delete;
  CpuWakeLimit& operator=(const CpuWakeLimit&) = delete;

  // False where the system has no such thing or refuses it, or when not asked.
  [[nodiscard]] bool held() const noexcept { return file_ >= 0; }

 private:
  int file_ = -1;
};

}  // namespace fathom::rt

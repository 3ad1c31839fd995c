#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/tiers/realtime_config.hpp"

namespace fathom::rt {

// One thing that real time needs from the machine.
struct ArmingCheck {
  std::string name;  // "SCHED_FIFO", "locked memory"
  bool ok = true;
  bool required = true;  // false: noted only, never in the way
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

// What the machine grants, without changing anything (a short-lived thread tries the priorities).
[[nodiscard]] ArmingResult checkArming(const RealtimeConfig& realtime, const MemoryBudget& budget);

// The same, and locks all memory of the process, present and future (mlockall); where that is refused, makes
// the present pages resident. Call when every pool is made, the heap is reserved (`heap`), and every thread
// is started, last thing before the loop begins.
[[nodiscard]] ArmingResult arm(const RealtimeConfig& realtime, const MemoryBudget& budget, HeapReserve& heap,
                               std::size_t heap_bytes);

}  // namespace fathom::rt

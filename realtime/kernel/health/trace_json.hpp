#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "realtime/kernel/health/stage_times.hpp"

namespace fathom::rt {

// One thread of a trace.
struct TraceThread {
  std::string name;                   // "navigation (SCHED_FIFO 80)"
  std::vector<std::string> stages;    // names, by stage number
  std::vector<TimelineEvent> events;  // of the time shown
  std::int64_t period_ns = 0;         // of a periodic thread's deadlines; 0: none
  std::int64_t deadline_ns = 0;       // any one of them (PeriodicLoop::nextDeadlineNs())
};

// Chrome's trace event format, which Perfetto (ui.perfetto.dev) opens. Times are monotonic, from < to; the
// trace counts from `from_ns`. Stages that overlap without nesting get separate tracks. The deadlines of a
// periodic thread are marked; those that a stage overran are marked as missed.
[[nodiscard]] std::string traceJson(const std::string& title, std::span<const TraceThread> threads,
                                    std::int64_t from_ns, std::int64_t to_ns);

}  // namespace fathom::rt

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/health/timeline.hpp"

namespace fathom::rt {

// One thread in the picture.
struct TimelineRow {
  std::string name;                   // "navigation", "vision"
  std::string note;                   // below it: "SCHED_FIFO 80, CPU 0"
  std::vector<StageSummary> stages;   // by stage number: names and p50, p99, max of the legend
  std::vector<TimelineEvent> events;  // of the time shown; nested ones are drawn below one another
  std::int64_t period_ns = 0;         // of a periodic row's deadlines; 0: none
  std::int64_t deadline_ns = 0;       // any one of them (PeriodicLoop::nextDeadlineNs())
};

struct TimelinePicture {
  std::string title;
  std::vector<TimelineRow> rows;
  std::int64_t from_ns = 0, to_ns = 0;  // monotonic; from < to
};

// Drawn: the whole time on one axis; below it a part enlarged, a cycle that ran late or else the longest
// frame; below that one cycle of the first periodic row; and a legend with each stage's p50, p99, maximum and
// misses. Cycles that ran past their next deadline are marked.
[[nodiscard]] std::string timelineSvg(const TimelinePicture& picture);

// A row from a running thread's stages and track, the last `duration_ns` before `now_ns`.
[[nodiscard]] TimelineRow timelineRow(std::string name, std::string note, StageTimes& times,
                                      const TimelineTrack& track, std::int64_t now_ns,
                                      std::int64_t duration_ns);

}  // namespace fathom::rt

#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace fathom::onboard {

class LiveSystem;

struct ThreadFigures {
  std::string name;
  double cpu_s = 0;
};
// Of every thread of this process, the busiest first.
[[nodiscard]] std::vector<ThreadFigures> cpuTimes();
// live.json, when the survey has ended.
[[nodiscard]] std::string liveJson(const LiveSystem& live_system, double wall_s);
// The last `seconds` of all tiers, in Chrome's trace format; while they run.
[[nodiscard]] std::string timelineOf(const LiveSystem& live, std::int64_t now_ns, double seconds);

}  // namespace fathom::onboard

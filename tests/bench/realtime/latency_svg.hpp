#pragma once

#include <string>
#include <vector>

#include "tests/bench/realtime/latency_histogram.hpp"

namespace fathom::bench {

struct LatencySeries {
  std::string name;
  std::vector<LatencyHistogram> minutes;
};

// Left: the share of wake-ups that were later than a time, both axes logarithmic, with each p99.9 marked.
// Right: each minute's p99.9 and maximum in the order in which they ran.
[[nodiscard]] std::string latencySvg(const std::string& title, const LatencySeries& ours,
                                     const LatencySeries& theirs);

}  // namespace fathom::bench

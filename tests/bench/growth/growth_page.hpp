#pragma once

#include <string>
#include <vector>

#include "tests/bench/growth/measured_run.hpp"

namespace fathom::growth {

// Of one source and number of jobs: time = a pairs^exponent, by least squares of logarithms. 1 is linear.
struct Growth {
  std::string source;
  int jobs = 1;
  double exponent = 0;
  double s_per_pair = 0;  // of the longest
};
[[nodiscard]] std::vector<Growth> growthOf(const std::vector<GrowthRun>& runs);

[[nodiscard]] std::string toCsv(const std::vector<GrowthRun>& runs);
[[nodiscard]] std::string toJson(const std::vector<GrowthRun>& runs);
// Time, time a pair by stage, and memory over the number of pairs, beside each other.
[[nodiscard]] std::string toSvg(const std::vector<GrowthRun>& runs);

}  // namespace fathom::growth

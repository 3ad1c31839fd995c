#pragma once

#include <cmath>
#include <ctime>
#include <utility>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"

namespace fathom::bench {

// A clock's time [ms]. The thread's own by default: other programs on the machine count little.
[[nodiscard]] inline double cpuMs(clockid_t clock = CLOCK_THREAD_CPUTIME_ID) {
  timespec t{};
  ::clock_gettime(clock, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}
[[nodiscard]] inline double wallMs() {
  return cpuMs(CLOCK_MONOTONIC);
}

[[nodiscard]] inline double meanOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}
[[nodiscard]] inline double rmsOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / static_cast<double>(values.size()));
}
// The quantile of a share of the values; 0 of none.
[[nodiscard]] inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto place = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  return ranked(std::move(values), place);
}

}  // namespace fathom::bench

#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <ctime>
#include <utility>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/order_statistics.hpp"

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
// The value below which a share of them lies; 0 of none.
[[nodiscard]] inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto place = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  return ranked(std::move(values), place);
}

[[nodiscard]] inline double areaOf(const Mesh& mesh) {  // [m2]
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return area;
}

}  // namespace fathom::bench

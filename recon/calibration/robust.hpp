#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace fathom::calibration {

// Median; 0 of nothing.
[[nodiscard]] inline double medianOf(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Standard deviation of a Gaussian with the same median absolute deviation about `centre`.
[[nodiscard]] inline double robustSigma(const std::vector<double>& values, double centre) {
  constexpr double kGaussian = 1.4826;
  std::vector<double> off;
  off.reserve(values.size());
  for (const double v : values) off.push_back(std::abs(v - centre));
  return kGaussian * medianOf(std::move(off));
}

// Weight of a residual of so many standard deviations: Cauchy's, 95 % efficient for a Gaussian (Holland and
// Welsch 1977).
[[nodiscard]] inline double cauchyWeight(double sigmas) {
  constexpr double kTuning = 2.385;
  const double x = sigmas / kTuning;
  return 1.0 / (1.0 + x * x);
}

}  // namespace fathom::calibration

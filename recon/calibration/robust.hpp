#pragma once

namespace fathom::calibration {

// Weight of a residual of so many standard deviations: Cauchy's, 95 % efficient for a Gaussian (Holland and
// Welsch 1977).
[[nodiscard]] inline double cauchyWeight(double sigmas) {
  constexpr double kTuning = 2.385;
  const double x = sigmas / kTuning;
  return 1.0 / (1.0 + x * x);
}

}  // namespace fathom::calibration

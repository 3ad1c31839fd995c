#include "recon/geometry/sea_water.hpp"

#include <cmath>

namespace fathom {
namespace {

// At sea level [m/s2].
double gravity(double latitude) {
  const double x = std::sin(latitude) * std::sin(latitude);
  return 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * x) * x);
}

}  // namespace

double depthFromPressure(double pressure_pa, double latitude) noexcept {
  constexpr double kDecibar = 1e4;  // [Pa]
  const double p = pressure_pa / kDecibar;
  const double work = (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p;
  return work / (gravity(latitude) + 1.092e-6 * p);
}

double depthFromPressure(double pressure_pa, double latitude, double density) noexcept {
  return pressure_pa / (density * gravity(latitude));
}

double soundSpeed(double t, double s, double d) noexcept {
  return 1448.96 + 4.591 * t - 5.304e-2 * t * t + 2.374e-4 * t * t * t + 1.340 * (s - 35.0) + 1.630e-2 * d +
         1.675e-7 * d * d - 1.025e-2 * t * (s - 35.0) - 7.139e-13 * t * d * d * d;
}

bool soundSpeedIsKnown(double t, double s, double d) noexcept {
  return t >= 2 && t <= 30 && s >= 25 && s <= 40 && d >= 0 && d <= 8000;
}

}  // namespace fathom

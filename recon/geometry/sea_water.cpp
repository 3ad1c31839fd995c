#include "recon/geometry/sea_water.hpp"

#include <cmath>
#include <limits>

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

double practicalSalinity(double conductivity, double temperature_c, double pressure_pa) noexcept {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  constexpr double kStandard = 4.2914;  // of S = 35, 15 deg C, no pressure [S/m]
  constexpr double kIts68 = 1.00024;    // the scale of 1978 has slightly smaller degrees
  const double t = temperature_c * kIts68, p = pressure_pa * 1e-4, r = conductivity / kStandard;
  if (!(temperature_c >= -2 && temperature_c <= 35 && r > 0 && p >= 0)) return kNaN;
  const double rp = 1 + p * (2.070e-5 + p * (-6.370e-10 + p * 3.989e-15)) /
                            (1 + t * (3.426e-2 + t * 4.464e-4) + r * (4.215e-1 - t * 3.107e-3));
  const double rt = 0.6766097 + t * (2.00564e-2 + t * (1.104259e-4 + t * (-6.9698e-7 + t * 1.0031e-9)));
  const double x = std::sqrt(r / (rp * rt));
  const double s = 0.0080 + x * (-0.1692 + x * (25.3851 + x * (14.0941 + x * (-7.0261 + x * 2.7081))));
  const double ds = 0.0005 + x * (-0.0056 + x * (-0.0066 + x * (-0.0375 + x * (0.0636 + x * -0.0144))));
  const double salinity = s + (t - 15) / (1 + 0.0162 * (t - 15)) * ds;
  return salinity >= 2 && salinity <= 42 ? salinity : kNaN;
}

bool soundSpeedIsKnown(double t, double s, double d) noexcept {
  return t >= 2 && t <= 30 && s >= 25 && s <= 40 && d >= 0 && d <= 8000;
}

}  // namespace fathom

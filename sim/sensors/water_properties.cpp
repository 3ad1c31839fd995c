#include "sim/sensors/water_properties.hpp"

#include <cmath>

namespace fathom::sim {

double soundSpeed(double t, double s, double d) {
  return 1448.96 + 4.591 * t - 5.304e-2 * t * t + 2.374e-4 * t * t * t + 1.340 * (s - 35.0) + 1.630e-2 * d +
         1.675e-7 * d * d - 1.025e-2 * t * (s - 35.0) - 7.139e-13 * t * d * d * d;
}

double practicalSalinity(double t, double conductivity_s_per_m) {
  constexpr double kStandardConductivity = 4.2914;  // of water of 35 psu at 15 deg C [S/m]
  const double ratio = conductivity_s_per_m / kStandardConductivity;
  const double rt = 0.6766097 + t * (2.00564e-2 + t * (1.104259e-4 + t * (-6.9698e-7 + t * 1.0031e-9)));
  const double x = std::sqrt(ratio / rt);
  const double s = 0.0080 + x * (-0.1692 + x * (25.3851 + x * (14.0941 + x * (-7.0261 + x * 2.7081))));
  const double ds = 0.0005 + x * (-0.0056 + x * (-0.0066 + x * (-0.0375 + x * (0.0636 + x * -0.0144))));
  return s + (t - 15.0) / (1.0 + 0.0162 * (t - 15.0)) * ds;
}

double conductivity(double temperature_c, double salinity_psu) {
  // Salinity grows with conductivity: bisection between bounds beyond any sea.
  constexpr int kHalvings = 60;
  double low = 0.0, high = 10.0;  // [S/m]
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (practicalSalinity(temperature_c, middle) < salinity_psu ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace fathom::sim

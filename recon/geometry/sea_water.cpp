#include "recon/geometry/sea_water.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "realtime/base/input_error.hpp"

namespace fathom {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kDecibar = 1e4;    // [Pa]
constexpr double kIts68 = 1.00024;  // the scale of 1968 has slightly smaller degrees

// At sea level [m/s2].
double gravity(double latitude) {
  const double x = std::sin(latitude) * std::sin(latitude);
  return 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * x) * x);
}

}  // namespace

double depthFromPressure(double pressure_pa, double latitude) noexcept {
  const double p = pressure_pa / kDecibar;
  const double work = (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p;
  return work / (gravity(latitude) + 1.092e-6 * p);
}

double depthFromPressure(double pressure_pa, double latitude, double density) noexcept {
  return pressure_pa / (density * gravity(latitude));
}

double soundSpeedAtPressure(double temperature_c, double s, double pressure_pa) noexcept {
  const double t = temperature_c * kIts68, p = pressure_pa * 1e-5;  // [bar]
  if (!(temperature_c >= -2 && temperature_c <= 40 && s >= 0 && s <= 40 && pressure_pa >= 0 &&
        pressure_pa <= 1e8))
    return kNaN;
  const double fresh0 =
      1402.388 + t * (5.03711 + t * (-5.80852e-2 + t * (3.3420e-4 + t * (-1.47800e-6 + t * 3.1464e-9))));
  const double fresh1 = 0.153563 + t * (6.8982e-4 + t * (-8.1788e-6 + t * (1.3621e-7 - t * 6.1185e-10)));
  const double fresh2 = 3.1260e-5 + t * (-1.7107e-6 + t * (2.5974e-8 + t * (-2.5335e-10 + t * 1.0405e-12)));
  const double fresh3 = -9.7729e-9 + t * (3.8504e-10 - t * 2.3643e-12);
  const double fresh = fresh0 + p * (fresh1 + p * (fresh2 + p * fresh3));
  const double a0 = 1.389 + t * (-1.262e-2 + t * (7.164e-5 + t * (2.006e-6 - t * 3.21e-8)));
  const double a1 = 9.4742e-5 + t * (-1.2580e-5 + t * (-6.4885e-8 + t * (1.0507e-8 - t * 2.0122e-10)));
  const double a2 = -3.9064e-7 + t * (9.1041e-9 + t * (-1.6002e-10 + t * 7.988e-12));
  const double a3 = 1.100e-10 + t * (6.649e-12 - t * 3.389e-13);
  const double a = a0 + p * (a1 + p * (a2 + p * a3));
  const double b = -1.922e-2 - 4.42e-5 * t + p * (7.3637e-5 + 1.7945e-7 * t);
  const double d = 1.727e-3 - 7.9836e-6 * p;
  return fresh + s * (a + b * std::sqrt(s) + d * s);
}

double soundSpeed(double temperature_c, double salinity_psu, double depth_m) noexcept {
  // Depth to decibars: Saunders (1981), "Practical conversion of pressure to depth", J. Phys. Oceanogr. 11.
  constexpr double kSquaredSine = 0.5;  // of the latitude
  constexpr double kLinear = 1 - (5.92 + 5.25 * kSquaredSine) * 1e-3, kSquare = 2.21e-6;
  const double decibar = (kLinear - std::sqrt(kLinear * kLinear - 4 * kSquare * depth_m)) / (2 * kSquare);
  return soundSpeedAtPressure(temperature_c, salinity_psu, decibar * kDecibar);
}

double practicalSalinity(double conductivity, double temperature_c, double pressure_pa) noexcept {
  constexpr double kStandard = 4.2914;  // of S = 35, 15 deg C, no pressure [S/m]
  const double t = temperature_c * kIts68, p = pressure_pa / kDecibar, r = conductivity / kStandard;
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

double Tide::heightAt(std::int64_t utc_ns) const noexcept {
  const double t = static_cast<double>(utc_ns - start_utc_ns) * 1e-9;
  return amplitude * std::sin(2 * std::numbers::pi * t / period + phase);
}

std::optional<Tide> readTide(const std::string& tide_model, std::int64_t start_utc_ns) {
  if (tide_model == "none" || tide_model.empty()) return std::nullopt;
  Tide tide;
  tide.start_utc_ns = start_utc_ns;
  int end = 0;
  const int read = std::sscanf(tide_model.c_str(), "sinusoid amplitude_m=%lf period_s=%lf phase_rad=%lf%n",
                               &tide.amplitude, &tide.period, &tide.phase, &end);
  const bool whole = read == 3 && static_cast<std::size_t>(end) == tide_model.size();
  if (!whole || !(tide.period > 0) || !std::isfinite(tide.amplitude) || !std::isfinite(tide.phase))
    throw InputError("mission.toml", "tide_model",
                     "'" + tide_model +
                         "' is an unknown model; give none, or sinusoid amplitude_m=A period_s=P "
                         "phase_rad=F, the height of the sea over nav's zero from start_time on");
  return tide;
}

}  // namespace fathom

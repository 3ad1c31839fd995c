#include "recon/geometry/geodesy.hpp"

#include <proj.h>

#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom {
namespace {

// Krueger's series as given by Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy
// 2011, equations 7 to 36, to the fourth order in the third flattening n.
constexpr double kSemiMajor = 6378137.0;             // WGS84 [m]
constexpr double kFlattening = 1.0 / 298.257223563;  // WGS84
constexpr double kN = kFlattening / (2.0 - kFlattening);
constexpr double kN2 = kN * kN, kN3 = kN2 * kN, kN4 = kN3 * kN;
constexpr double kRectifying = kSemiMajor / (1.0 + kN) * (1.0 + kN2 / 4.0 + kN4 / 64.0);  // [m]
constexpr double kAlpha[4] = {kN / 2 - 2 * kN2 / 3 + 5 * kN3 / 16 + 41 * kN4 / 180,
                              13 * kN2 / 48 - 3 * kN3 / 5 + 557 * kN4 / 1440,
                              61 * kN3 / 240 - 103 * kN4 / 140, 49561 * kN4 / 161280};
constexpr double kBeta[4] = {kN / 2 - 2 * kN2 / 3 + 37 * kN3 / 96 - kN4 / 360,
                             kN2 / 48 + kN3 / 15 - 437 * kN4 / 1440, 17 * kN3 / 480 - 37 * kN4 / 840,
                             4397 * kN4 / 161280};

double eccentricity() {
  return std::sqrt(kFlattening * (2.0 - kFlattening));
}

// Conformal latitude's tangent from the latitude's (Karney eq. 7-9).
double conformalTangent(double tau) {
  const double e = eccentricity();
  const double sigma = std::sinh(e * std::atanh(e * tau / std::sqrt(1.0 + tau * tau)));
  return tau * std::sqrt(1.0 + sigma * sigma) - sigma * std::sqrt(1.0 + tau * tau);
}

// (xi, eta): northing and easting over the rectifying radius; longitude relative to the central meridian.
std::complex<double> forward(double latitude, double longitude) {
  const double tau = conformalTangent(std::tan(latitude));
  const std::complex<double> zeta(std::atan2(tau, std::cos(longitude)),
                                  std::asinh(std::sin(longitude) / hypotenuse(tau, std::cos(longitude))));
  std::complex<double> sum = zeta;
  for (int j = 0; j < 4; ++j) sum += kAlpha[j] * std::sin(2.0 * (j + 1) * zeta);
  return sum;
}

using ContextPtr = std::unique_ptr<PJ_CONTEXT, decltype(&proj_context_destroy)>;
using ProjPtr = std::unique_ptr<PJ, decltype(&proj_destroy)>;

Eigen::Vector2d projToLocal(const Geodetic& origin, const Geodetic& position) {
  const ContextPtr context(proj_context_create(), &proj_context_destroy);
  const std::string definition =
      formatted("+proj=tmerc +ellps=WGS84 +k=1 +x_0=0 +y_0=0 +lat_0=%.15g +lon_0=%.15g",
                origin.latitude * kDegreesPerRadian, origin.longitude * kDegreesPerRadian);
  const ProjPtr pj(proj_create(context.get(), definition.c_str()), &proj_destroy);
  if (!pj) throw std::runtime_error("PROJ refuses " + definition);
  const PJ_COORD xy = proj_trans(pj.get(), PJ_FWD, proj_coord(position.longitude, position.latitude, 0, 0));
  return {xy.xy.y, xy.xy.x};
}

}  // namespace

LocalTransverseMercator::LocalTransverseMercator(const Geodetic& origin) : origin_(origin) {
  if (!(std::abs(origin.latitude) < std::numbers::pi / 2) ||
      !(std::abs(origin.longitude) <= std::numbers::pi))
    throw std::runtime_error("origin latitude or longitude out of range");
  origin_northing_ = kRectifying * forward(origin.latitude, 0.0).real();
  constexpr double kProbe = 0.005;     // [rad], about 30 km
  constexpr double kTolerance = 1e-3;  // [m]
  const double toward_equator = origin.latitude > 0 ? -kProbe : kProbe;
  const Geodetic probe{origin.latitude + toward_equator, origin.longitude + kProbe};
  const double difference = (projToLocal(origin, probe) - toLocal(probe)).norm();
  if (!(difference < kTolerance))
    throw std::runtime_error("local transverse Mercator series and PROJ differ by " +
                             std::to_string(difference) + " m");
}

Eigen::Vector2d LocalTransverseMercator::toLocal(const Geodetic& position) const {
  const double longitude = std::remainder(position.longitude - origin_.longitude, 2.0 * std::numbers::pi);
  const std::complex<double> z = kRectifying * forward(position.latitude, longitude);
  return {z.real() - origin_northing_, z.imag()};
}

Geodetic LocalTransverseMercator::toGeodetic(const Eigen::Vector2d& north_east) const {
  const std::complex<double> zeta((north_east.x() + origin_northing_) / kRectifying,
                                  north_east.y() / kRectifying);
  std::complex<double> z = zeta;
  for (int j = 0; j < 4; ++j) z -= kBeta[j] * std::sin(2.0 * (j + 1) * zeta);
  const double sinh_eta = std::sinh(z.imag());
  const double tau_conformal = std::sin(z.real()) / hypotenuse(sinh_eta, std::cos(z.real()));
  // Newton iteration of Karney eq. 19-21.
  const double e2 = kFlattening * (2.0 - kFlattening);
  double tau = tau_conformal;
  constexpr int kIterations = 5;
  for (int i = 0; i < kIterations; ++i) {
    const double tau_i = conformalTangent(tau);
    tau += (tau_conformal - tau_i) / std::sqrt(1.0 + tau_i * tau_i) * (1.0 + (1.0 - e2) * tau * tau) /
           ((1.0 - e2) * std::sqrt(1.0 + tau * tau));
  }
  const double longitude = origin_.longitude + std::atan2(sinh_eta, std::cos(z.real()));
  return {std::atan(tau), std::remainder(longitude, 2.0 * std::numbers::pi)};
}

double meridianConvergence(double east, double latitude) noexcept {
  constexpr double kEquator = 6378137.0, kEccentricity2 = 6.69437999014e-3;  // of WGS84 [m], [1]
  const double sine = std::sin(latitude);
  return east / kEquator * std::sqrt(1 - kEccentricity2 * sine * sine) * std::tan(latitude);
}

int utmZone(double longitude) noexcept {
  return static_cast<int>(std::floor((longitude / kRadiansPerDegree + 180) / 6)) % 60 + 1;
}

}  // namespace fathom

#include "sim/sensors/waves.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

constexpr double kGravity = 9.81;  // [m/s^2]
constexpr int kComponents = 80;
// Frequency range of the spectrum over its peak's; less than 2 % of the variance is outside.
constexpr double kLowest = 0.5, kHighest = 4.0;
constexpr int kSpectrumBins = 2000;

// JONSWAP's density of the variance, not scaled, at a frequency over the peak's.
double density(double f) {
  constexpr double kEnhancement = 3.3;
  const double width = f <= 1 ? 0.07 : 0.09;
  const double bump = std::exp(-(f - 1) * (f - 1) / (2 * width * width));
  return std::pow(f, -5) * std::exp(-1.25 * std::pow(f, -4)) * std::pow(kEnhancement, bump);
}

// k of omega^2 = g k tanh(k h), by Newton's iteration.
double waveNumber(double rate, double water_depth_m) {
  const double deep = rate * rate / kGravity * water_depth_m;  // k h in deep water
  double kh = std::max(deep, std::sqrt(deep));
  constexpr int kIterations = 20;
  for (int i = 0; i < kIterations; ++i) {
    const double t = std::tanh(kh);
    kh -= (kh * t - deep) / (t + kh * (1 - t * t));
  }
  return kh / water_depth_m;
}

}  // namespace

Waves::Waves(const WavesConfig& config, std::uint64_t seed, double water_depth_m)
    : water_depth_m_(water_depth_m) {
  if (config.height_m <= 0) return;
  Random random(seed, "waves");
  constexpr double kStep = (kHighest - kLowest) / kSpectrumBins;
  std::vector<double> up_to(kSpectrumBins + 1, 0.0);
  for (int i = 0; i < kSpectrumBins; ++i)
    up_to[static_cast<std::size_t>(i) + 1] =
        up_to[static_cast<std::size_t>(i)] + density(kLowest + (i + 0.5) * kStep);
  const double amplitude = config.height_m / 4 * std::sqrt(2.0 / kComponents);
  for (int i = 0; i < kComponents; ++i) {
    const double share = (i + random.uniform()) / kComponents * up_to.back();
    const auto after = std::upper_bound(up_to.begin(), up_to.end(), share);
    const auto bin = static_cast<std::size_t>(after - up_to.begin()) - 1;
    const double within = (share - up_to[bin]) / (up_to[bin + 1] - up_to[bin]);
    const double relative = kLowest + (static_cast<double>(bin) + within) * kStep;
    const double rate = 2 * std::numbers::pi / config.period_s * relative;
    const double towards = config.towards + random.gauss(config.spreading);
    const double number = waveNumber(rate, water_depth_m);
    components_.push_back({amplitude, rate, random.uniform(0.0, 2 * std::numbers::pi),
                           number * Eigen::Vector2d(std::cos(towards), std::sin(towards))});
  }
}

double Waves::heightAt(const Eigen::Vector2d& place, double time_s) const {
  double sum = 0;
  for (const Component& c : components_) sum += c.amplitude * std::cos(c.phaseAt(place, time_s));
  return sum;
}

double Waves::pressureAt(const Eigen::Vector3d& place, double water_depth_m, double time_s) const {
  const double below = std::clamp(place.z(), 0.0, water_depth_m);
  double sum = 0;
  for (const Component& c : components_) {
    const double k = c.number.norm();
    // cosh(k (h - z)) / cosh(k h) without overflow in deep water.
    const double left = std::exp(-k * below) * (1 + std::exp(-2 * k * (water_depth_m - below))) /
                        (1 + std::exp(-2 * k * water_depth_m));
    sum += left * c.amplitude * std::cos(c.phaseAt(place.head<2>(), time_s));
  }
  return sum;
}

Eigen::Vector2d Waves::shiftAt(const Eigen::Vector2d& place, double time_s) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Component& c : components_) {
    const double k = c.number.norm();
    sum -= c.amplitude / std::tanh(k * water_depth_m_) * std::sin(c.phaseAt(place, time_s)) * c.number / k;
  }
  return sum;
}

}  // namespace fathom::sim

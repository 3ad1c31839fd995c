#include "recon/lighting/colour_light.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace fathom::lighting {
namespace {

// Least spread over mean of the mean channel's linear light: hazy dives and mud have less and are lifted to
// it. All channels are lifted alike, so that hues stay.
constexpr float kLeastContrast = 0.2F, kGamma = 2.2F;
constexpr float kLeastLight = 0.3F;  // from the ground, of all: with less, gain would show noise alone
constexpr float kLeast = 0.002F;     // of full scale: half a level of 8 bits

// IEC 61966-2-1, of a level well above black.
float linearOf(float srgb) {
  return std::pow((srgb + 0.055F) / 1.055F, 2.4F);
}

constexpr float kPedestalsPerOctave = 2;  // classes of expected brightness

constexpr float kGross = 3.0F;  // times the expected light, or a part of it: a fish, a glint, no tilt

// Coefficients of the three unknowns; the response is 1 plus their products.
Eigen::Vector3f factors(const RangeLattice::Ground& ground) {
  const float depth = ground.point.z();
  return {-ground.normal.dot(ground.point) / depth - 1, ground.normal.x() / depth, ground.normal.y() / depth};
}

}  // namespace

void TiltResponse::add(const RangeLattice::Ground& ground, float ratio) {
  if (!(ratio > 1 / kGross && ratio < kGross) || !(ground.point.z() > 0)) return;
  const Eigen::Vector3d f = factors(ground).cast<double>();
  normal_ += f * f.transpose();
  right_ += f * (static_cast<double>(ratio) - 1);
}

void TiltResponse::solve() {
  constexpr double kPatch = 0.3;     // spread of what patches return beside tilt
  constexpr double kAlike = 50;      // patches that share their ground with others
  constexpr double kStrength = 0.3;  // prior, about 1
  constexpr double kAside = 0.5;     // prior, about the camera [m]
  const double weight = 1 / (kPatch * kPatch * kAlike);
  const Eigen::Vector3d prior(1 / (kStrength * kStrength), 1 / (kAside * kAside), 1 / (kAside * kAside));
  Eigen::Matrix3d a = weight * normal_;
  a.diagonal() += prior;
  const Eigen::Vector3d b = weight * right_ + prior.x() * Eigen::Vector3d::UnitX();
  const Eigen::Vector3d x = a.ldlt().solve(b);
  if (!x.allFinite()) return;
  solution_ = {static_cast<float>(std::clamp(x.x(), 0.0, 1.5)), static_cast<float>(x.y()),
               static_cast<float>(x.z())};
}

void TiltResponse::halve() {
  normal_ /= 2;
  right_ /= 2;
}

float TiltResponse::at(const RangeLattice::Ground& ground) const {
  if (!(ground.point.z() > 0)) return 1;
  return std::clamp(1 + solution_.dot(factors(ground)), kDarkest, kBrightest);
}

void Pedestal::add(float expected, float ratio) {
  if (!(expected > 0) || !(ratio < kGross)) return;
  const float at = std::round(-kPedestalsPerOctave * std::log2(expected));
  const auto k = static_cast<std::size_t>(std::clamp(at, 0.0F, static_cast<float>(kClasses - 1)));
  count_[k] += 1, expected_[k] += expected, sum_[k] += ratio, squares_[k] += ratio * ratio;
}

void Pedestal::solve() {
  constexpr double kFewest = 200;  // nodes of a class
  constexpr double kAlike = 50;    // nodes that share their ground with others
  constexpr double kOther = 0.15;  // relative: other ground has other contrast
  constexpr double kUsual = 0.02;  // prior, about 0: parts of full scale
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0, least = 1;
  for (std::size_t k = 0; k < count_.size(); ++k) {
    const double n = count_[k];
    if (n < kFewest) continue;
    const double mean = sum_[k] / n, variance = squares_[k] / n - mean * mean;
    if (!(variance > 0)) continue;
    const double contrast = std::sqrt(variance), m = expected_[k] / n;
    const double weight = 1 / (variance * (kAlike / (2 * n) + kOther * kOther));
    w += weight, wx += weight / m, wy += weight * contrast;
    wxx += weight / (m * m), wxy += weight * contrast / m;
    least = std::min(least, m);
  }
  level_ = 0;
  if (w == 0) return;
  // contrast = c0 - (c0 b) / m; the prior holds c0 b by the contrast that is usual here.
  const double usual = wy / w * kUsual;
  const double slope = (wxy - wx * wy / w) / (wxx - wx * wx / w + 1 / (usual * usual));
  const double at_full = (wy - slope * wx) / w;
  constexpr double kMost = 0.8;  // of the darkest class
  if (at_full > 0) level_ = static_cast<float>(std::clamp(-slope / at_full, 0.0, kMost * least));
}

void Pedestal::halve() {
  for (std::size_t k = 0; k < count_.size(); ++k)
    count_[k] /= 2, expected_[k] /= 2, sum_[k] /= 2, squares_[k] /= 2;
}

ColourLight::ColourLight(std::size_t channels, bool encoded, int bits, double grey)
    : encoded_(encoded),
      full_(static_cast<float>((1 << bits) - 1)),
      light_(encoded ? static_cast<float>(grey) : linearOf(static_cast<float>(grey))),
      pedestals_(channels) {}

void ColourLight::learn(std::size_t channel, float expected, float ratio,
                        const RangeLattice::Ground* ground) {
  pedestals_[channel].add(expected, ratio);
  if (ground != nullptr) tilt_.add(*ground, tilt_.at(*ground) * ratio);
}

void ColourLight::solve(float contrast) {
  const float least = encoded_ ? kLeastContrast / kGamma : kLeastContrast;
  lift_ = std::max(1.0F, least / std::max(contrast, kLeast));
  tilt_.solve();
  for (Pedestal& p : pedestals_) p.solve();
}

void ColourLight::halve() {
  tilt_.halve();
  for (Pedestal& p : pedestals_) p.halve();
}

float ColourLight::samplesFor(double light) const {
  return static_cast<float>(encoded_ ? std::pow(light, 1 / kGamma) : light);
}

Correction ColourLight::correction(std::size_t channel, const Level& level, float brightness) const {
  const float mean = brightness * std::exp(level.log_mean);
  const float returned = std::max({mean - pedestal(channel), kLeastLight * mean, kLeast});
  const float to = encoded_ ? 255.0F : 1.0F, gain = light_ * lift_ / returned;
  return {to * gain / full_, to * (light_ - gain * mean)};
}

}  // namespace fathom::lighting

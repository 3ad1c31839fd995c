#include "recon/navigation/dead_reckoning/depth_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fathom::nav {
namespace {

constexpr double kCalmRate = 0.8;    // omega in a calm sea [rad/s]: a velocity wrong by 2 mm/s leaves 4 mm
constexpr double kCalm = 0.005;      // noise of depth and velocity in a calm sea, at most [m]
constexpr double kPressureRate = 3;  // omega where pressure is all there is [rad/s]
constexpr double kHighPass_s = 5;    // time constant: swell of 20 s still passes by 0.7
constexpr double kMemory_s = 60;     // of the variance: a few groups of waves
constexpr double kFirst_s = 10;      // until then all is taken as it is
constexpr double kOutlier = 3;       // standard deviations that one reading counts for at most

}  // namespace

void DepthFilter::start(double pressure_depth) noexcept {
  *this = {};
  depth_ = pressure_ = pressure_depth;
}

double DepthFilter::sigma() const noexcept {
  return std::sqrt(std::max(variance_ - kCalm * kCalm, 0.0));
}

void DepthFilter::add(double seconds, double moved, double pressure_depth) noexcept {
  if (!silent_) learn(seconds, pressure_depth - pressure_ - moved);
  follow(kCalmRate * std::sqrt(kCalm / std::hypot(sigma(), kCalm)), seconds, moved, pressure_depth);
}

void DepthFilter::addWithoutVelocity(double seconds, double moved, double pressure_depth) noexcept {
  follow(kPressureRate, seconds, moved, pressure_depth);
}

void DepthFilter::addWithoutPressure(double moved) noexcept {
  depth_ += moved;
  rate_ = 0;
  silent_ = true;
}

// `change` of pressure less the velocity's sum. A velocity that is wrong for a while gives a slow change,
// which the second filter leaves little of, and one that is an outlier counts for no more than an outlier.
void DepthFilter::learn(double seconds, double change) noexcept {
  const double keeps = kHighPass_s / (kHighPass_s + seconds);
  const double before = fast_;
  fast_ = keeps * (fast_ + change);
  faster_ = keeps * (faster_ + fast_ - before);
  const double most = kOutlier * kOutlier * (variance_ + kCalm * kCalm);
  const double square = learnt_s_ < kFirst_s ? faster_ * faster_ : std::min(faster_ * faster_, most);
  learnt_s_ = std::min(learnt_s_ + seconds, kMemory_s);
  variance_ += std::min(seconds / learnt_s_, 1.0) * (square - variance_);
}

void DepthFilter::follow(double omega, double seconds, double moved, double pressure_depth) noexcept {
  const double damping = std::numbers::sqrt2 * omega * seconds, stiffness = omega * omega * seconds;
  rate_ = (rate_ + stiffness * (pressure_depth - depth_ - moved)) / (1 + damping + stiffness * seconds);
  depth_ += moved + rate_ * seconds;
  pressure_ = pressure_depth;
  silent_ = false;
}

}  // namespace fathom::nav

#include "realtime/onboard/map/position_anchor.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::onboard {
namespace {

constexpr double kMinSigma = 0.1;     // [m] no fix is trusted better
constexpr double kMaxSigma = 1000.0;  // [m] a fix worse than this is no fix
constexpr double kGate = 3.0;         // standard deviations
// Scale of the median absolute deviation to a standard deviation of a normal distribution.
constexpr double kMadToSigma = 1.4826;

double median(std::array<double, PositionAnchor::kCapacity>& values, int size) {
  const auto middle = values.begin() + size / 2;
  std::nth_element(values.begin(), middle, values.begin() + size);
  return *middle;
}

}  // namespace

void PositionAnchor::add(const PositionFix& fix) noexcept {
  ++(fix.kind == FixKind::kGps ? counters_.gps : counters_.usbl);
  Series& series = fix.kind == FixKind::kGps ? gps_ : usbl_;
  const bool sane = fix.north_east.allFinite() && fix.sigma >= 0 && fix.sigma < kMaxSigma;
  if (!sane || series.size == kCapacity) {
    ++counters_.refused;
    return;
  }
  series.items[static_cast<std::size_t>(series.size++)] = {
      fix.north_east - fix.T_odom_sensor.translation().head<2>(), std::max(fix.sigma, kMinSigma)};
}

std::optional<PositionAnchor::Solution> PositionAnchor::solve(const Series& series) noexcept {
  if (series.size == 0) return std::nullopt;
  Eigen::Vector2d centre, spread;
  std::array<double, kCapacity> values;
  for (int axis = 0; axis < 2; ++axis) {
    for (int i = 0; i < series.size; ++i)
      values[static_cast<std::size_t>(i)] = series.items[static_cast<std::size_t>(i)].north_east(axis);
    centre(axis) = median(values, series.size);
    for (int i = 0; i < series.size; ++i)
      values[static_cast<std::size_t>(i)] =
          std::abs(series.items[static_cast<std::size_t>(i)].north_east(axis) - centre(axis));
    spread(axis) = kMadToSigma * median(values, series.size);
  }
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double weight = 0;
  for (int i = 0; i < series.size; ++i) {
    const Difference& d = series.items[static_cast<std::size_t>(i)];
    const Eigen::Vector2d gate = kGate * (spread.array().max(d.sigma)).matrix();
    if (((d.north_east - centre).cwiseAbs().array() > gate.array()).any()) continue;
    const double w = 1.0 / (d.sigma * d.sigma);
    sum += w * d.north_east;
    weight += w;
  }
  // The median itself lies in the gate of at least one difference unless the axes disagree wholly.
  if (weight <= 0) return Solution{centre, spread.maxCoeff()};
  return Solution{sum / weight, 1.0 / std::sqrt(weight)};
}

std::optional<PositionAnchor::Solution> PositionAnchor::best() const noexcept {
  const auto gps = solve(gps_);
  return gps ? gps : solve(usbl_);
}

std::optional<SE3> PositionAnchor::estimate() const noexcept {
  const auto solution = best();
  if (!solution) return std::nullopt;
  return SE3(Eigen::Quaterniond::Identity(), {solution->north_east.x(), solution->north_east.y(), 0.0});
}

double PositionAnchor::sigma() const noexcept {
  const auto solution = best();
  return solution ? solution->sigma : 0.0;
}

}  // namespace fathom::onboard

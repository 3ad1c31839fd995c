#include "realtime/kernel/time/clock_line.hpp"

namespace fathom::rt {
namespace {

double weightOf(const ClockPoint& point) {
  return 1 / (point.sigma * point.sigma);
}

}  // namespace

void ClockLine::add(const ClockPoint& point) noexcept {
  (void)points_.pushDroppingOldest(point);
  double weight = 0, time = 0, lag = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) weight += weightOf(points_[i]);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    time += weightOf(points_[i]) * points_[i].time / weight;
    lag += weightOf(points_[i]) * points_[i].lag / weight;
  }
  double square = 1 / (rate_sigma_ * rate_sigma_), product = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const double weighted = weightOf(points_[i]) * (points_[i].time - time);
    square += weighted * (points_[i].time - time);
    product += weighted * (points_[i].lag - lag);
  }
  centre_ = time;
  level_ = lag;
  rate_ = square > 0 ? product / square : 0;
}

}  // namespace fathom::rt

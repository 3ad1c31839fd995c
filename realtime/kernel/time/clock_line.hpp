#pragma once

#include <cstddef>
#include <limits>

#include "realtime/kernel/rings/fixed_queue.hpp"

namespace fathom::rt {

// At `time` of a device's clock the vehicle's clock shows `lag` more, with standard deviation `sigma`. All in
// seconds relative to some first stamp and base, so that they stay small.
struct ClockPoint {
  double time = 0, lag = 0;
  double sigma = 1;  // alike for all: an unweighted fit

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) { archive(self.time, self.lag, self.sigma); }
};

// A device's clock against the vehicle's: line through the last points by weighted least squares,
//
//   lag(time) = level + rate (time - centre)
//
// with a prior of 0 +- `rate_sigma` on the rate, so that a short history cannot give a wild one. The caller
// gates points and rates. Fixed memory; same calls, same result.
class ClockLine {
 public:
  using Points = FixedQueue<ClockPoint, 64>;

  explicit ClockLine(double rate_sigma = std::numeric_limits<double>::infinity()) noexcept
      : rate_sigma_(rate_sigma) {}

  // Adds a point and fits again; when full, drops the oldest.
  void add(const ClockPoint& point) noexcept;
  // Forgets the points; the line stays.
  void forgetPoints() noexcept { points_.clear(); }
  void restart() noexcept {
    forgetPoints();
    hold(0);
  }
  // Constant lag until points are added.
  void hold(double lag) noexcept {
    level_ = lag;
    rate_ = 0;
  }
  void setRate(double rate) noexcept { rate_ = rate; }

  [[nodiscard]] double at(double time) const noexcept { return level_ + rate_ * (time - centre_); }
  [[nodiscard]] double rate() const noexcept { return rate_; }
  [[nodiscard]] const Points& points() const noexcept { return points_; }

  static void exchange(auto& archive, auto& self) {
    archive(self.points_, self.centre_, self.level_, self.rate_);
  }

 private:
  double rate_sigma_;
  Points points_;
  double centre_ = 0, level_ = 0, rate_ = 0;
};

}  // namespace fathom::rt

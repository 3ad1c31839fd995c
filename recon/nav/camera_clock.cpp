#include "recon/nav/camera_clock.hpp"

#include <cmath>

namespace fathom::nav {
namespace {

constexpr double kSecond = 1e9;    // [ns]
constexpr double kLeap = 0.1;      // of a window's least delay from the line: no clock drifts so [s]
constexpr double kMaxRate = 5e-4;  // of a quartz, with margin [s/s]

}  // namespace

std::int64_t CameraClock::utcNs(std::int64_t stamp_ns, std::int64_t arrival_utc_ns) noexcept {
  if (!any_) {
    any_ = true;
    first_stamp_ns_ = stamp_ns;
    base_ns_ = arrival_utc_ns - stamp_ns;
  }
  const Least seen{static_cast<double>(stamp_ns - first_stamp_ns_) / kSecond,
                   static_cast<double>(arrival_utc_ns - stamp_ns - base_ns_) / kSecond};
  if (in_window_ == 0 || seen.delay < least_.delay) least_ = seen;
  if (++in_window_ == kWindow) close();
  lost_ = leapt_ + (windows_.size() < kFewest ? 0.0 : lineAt(seen.time) - start_);
  return stamp_ns + std::llround(lost_ * kSecond);
}

void CameraClock::close() noexcept {
  in_window_ = 0;
  if (!based_) {
    // Differences count from the first window's least.
    based_ = true;
    base_ns_ += std::llround(least_.delay * kSecond);
    least_.delay = 0;
  }
  if (windows_.size() >= kFewest && std::abs(least_.delay - lineAt(least_.time)) > kLeap) {
    // The clock leapt: the line goes on without the leap.
    const double leap = least_.delay - lineAt(least_.time);
    base_ns_ += std::llround(leap * kSecond);
    leapt_ += leap;
    least_.delay -= leap;
    ++leaps_;
  }
  (void)windows_.pushDroppingOldest(least_);
  fit();
  if (windows_.size() == kFewest && start_ == 0) start_ = lineAt(0);
}

void CameraClock::fit() noexcept {
  const auto n = static_cast<double>(windows_.size());
  double time = 0, delay = 0;
  for (std::size_t i = 0; i < windows_.size(); ++i) {
    time += windows_[i].time / n;
    delay += windows_[i].delay / n;
  }
  double square = 0, product = 0;
  for (std::size_t i = 0; i < windows_.size(); ++i) {
    square += (windows_[i].time - time) * (windows_[i].time - time);
    product += (windows_[i].time - time) * (windows_[i].delay - delay);
  }
  centre_ = time;
  level_ = delay;
  rate_ = square > 0 ? product / square : 0;
  if (std::abs(rate_) > kMaxRate) rate_ = 0;
}

}  // namespace fathom::nav

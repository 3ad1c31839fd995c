#include "recon/navigation/dead_reckoning/camera_clock.hpp"

#include <cmath>

#include "realtime/base/units.hpp"

namespace fathom::nav {
namespace {

constexpr double kLeap = 0.1;      // of a window's least delay from the line: no clock drifts so [s]
constexpr double kMaxRate = 5e-4;  // of a quartz, with margin [s/s]

}  // namespace

std::int64_t CameraClock::utcNs(std::int64_t stamp_ns, std::int64_t arrival_utc_ns) noexcept {
  if (!any_) {
    any_ = true;
    first_stamp_ns_ = stamp_ns;
    base_ns_ = arrival_utc_ns - stamp_ns;
  }
  const rt::ClockPoint seen{rt::seconds(stamp_ns - first_stamp_ns_),
                            rt::seconds(arrival_utc_ns - stamp_ns - base_ns_)};
  if (in_window_ == 0 || seen.lag < least_.lag) least_ = seen;
  if (++in_window_ == kWindow) close();
  lost_ = leapt_ + (line_.points().size() < kFewest ? 0.0 : line_.at(seen.time) - start_);
  return stamp_ns + rt::nanoseconds(lost_);
}

void CameraClock::close() noexcept {
  in_window_ = 0;
  if (!based_) {
    // Differences count from the first window's least.
    based_ = true;
    base_ns_ += rt::nanoseconds(least_.lag);
    least_.lag = 0;
  }
  if (line_.points().size() >= kFewest && std::abs(least_.lag - line_.at(least_.time)) > kLeap) {
    // The clock has leapt: the line continues without the leap.
    const double leap = least_.lag - line_.at(least_.time);
    base_ns_ += rt::nanoseconds(leap);
    leapt_ += leap;
    least_.lag -= leap;
    ++leaps_;
  }
  line_.add(least_);
  if (std::abs(line_.rate()) > kMaxRate) line_.setRate(0);
  if (line_.points().size() == kFewest && start_ == 0) start_ = line_.at(0);
}

}  // namespace fathom::nav

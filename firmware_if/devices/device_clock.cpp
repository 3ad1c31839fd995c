#include "firmware_if/devices/device_clock.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::io {
namespace {

constexpr double kSecond = 1e9;  // [ns]

std::int64_t nanoseconds(double seconds) {
  return std::llround(seconds * kSecond);
}

}  // namespace

void DeviceClock::restart() noexcept {
  any_ = false;
  late_in_row_ = 0;
}

void DeviceClock::begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  any_ = true;
  first_stamp_ns_ = stamp_ns;
  base_ns_ = arrival_ns - stamp_ns;
  windows_.clear();
  window_begin_ = centre_ = level_ = rate_ = 0;
  least_ = Least{};
  late_in_row_ = 0;
}

std::int64_t DeviceClock::vehicleNs(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  if (!any_) begin(stamp_ns, arrival_ns);
  Least seen{static_cast<double>(stamp_ns - first_stamp_ns_) / kSecond,
             static_cast<double>(arrival_ns - stamp_ns - base_ns_) / kSecond};
  // Before the first window is whole, the least so far is the best that is known.
  const double off = seen.delay - (windows_.empty() ? least_.delay : lineAt(seen.time));
  const bool early = off<-config_.leap_s, late = off> config_.leap_s;
  if (late) {
    const bool alike = late_in_row_ > 0 && std::abs(seen.delay - late_delay_) < config_.leap_s;
    late_in_row_ = alike ? late_in_row_ + 1 : 1;
    late_delay_ = seen.delay;
  } else {
    late_in_row_ = 0;
  }
  if (early || late_in_row_ == kLateAlike) {
    // Before there is a window it is more likely the first message that was held up.
    if (!windows_.empty()) ++leaps_;
    begin(stamp_ns, arrival_ns);
    seen = Least{};
  } else if (late) {
    ++late_;
    if (off > config_.held_up_s) return arrival_ns - nanoseconds(config_.latency_s);
    return stamp_ns + base_ns_ + nanoseconds(seen.delay - off - config_.latency_s + config_.resolution_s / 2);
  }
  if (seen.time - window_begin_ >= kWindow) {
    (void)windows_.pushDroppingOldest(least_);
    window_begin_ = seen.time;
    least_ = seen;
    fit();
  } else if (seen.delay <= least_.delay || seen.time == window_begin_) {
    least_ = seen;
  }
  const double delay = windows_.empty() ? least_.delay : std::min(lineAt(seen.time), seen.delay);
  offset_ns_ = base_ns_ + nanoseconds(delay - config_.latency_s);
  // The least delay is that of a stamp that lost nothing by being cut.
  return std::min(stamp_ns + offset_ns_ + nanoseconds(config_.resolution_s / 2), arrival_ns);
}

void DeviceClock::fit() noexcept {
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
  rate_ = 0;
  if (windows_.size() < kFewest || square <= 0) return;
  rate_ = std::clamp(product / square, -config_.max_rate, config_.max_rate);
}

}  // namespace fathom::io

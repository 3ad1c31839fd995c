#include "firmware_if/devices/vehicle_time.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

using rt::nanoseconds;
using rt::seconds;

// Slewing (adjtime, NTP) moves a clock by at most 0.5 ms a second; more between two looks is a step.
constexpr std::int64_t kClockStep_ns = kMillisecond_ns;
// A frame may have come this much before the queue was last looked at and found empty.
constexpr std::int64_t kQueueSlack_ns = 20 * kMillisecond_ns;

}  // namespace

void DeviceClock::restart() noexcept {
  any_ = false;
  late_in_row_ = 0;
}

void DeviceClock::begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  any_ = true;
  first_stamp_ns_ = stamp_ns;
  base_ns_ = arrival_ns - stamp_ns;
  line_.restart();
  window_begin_ = 0;
  least_ = {};
  late_in_row_ = 0;
}

std::int64_t DeviceClock::vehicleNs(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  if (!any_) begin(stamp_ns, arrival_ns);
  rt::ClockPoint point{seconds(stamp_ns - first_stamp_ns_), seconds(arrival_ns - stamp_ns - base_ns_)};
  // Before the first window is whole, the least so far stands for the line.
  const double off = point.lag - (line_.points().empty() ? least_.lag : line_.at(point.time));
  const bool early = off<-config_.leap_s, late = off> config_.leap_s;
  if (late) {
    const bool alike = late_in_row_ > 0 && std::abs(point.lag - late_delay_) < config_.leap_s;
    late_in_row_ = alike ? late_in_row_ + 1 : 1;
    late_delay_ = point.lag;
  } else {
    late_in_row_ = 0;
  }
  if (early || late_in_row_ == kLateAlike) {
    // Before the first window is whole, the first message was more likely delayed.
    if (!line_.points().empty()) ++leaps_;
    begin(stamp_ns, arrival_ns);
    point = {};
  } else if (late) {
    ++late_;
    if (off > config_.held_up_s) return arrival_ns - nanoseconds(config_.latency_s);
    return stamp_ns + base_ns_ + nanoseconds(point.lag - off - config_.latency_s + config_.resolution_s / 2);
  }
  if (point.time - window_begin_ >= kWindow) {
    line_.add(least_);
    line_.setRate(
        line_.points().size() < kFewest ? 0 : std::clamp(line_.rate(), -config_.max_rate, config_.max_rate));
    window_begin_ = point.time;
    least_ = point;
  } else if (point.lag <= least_.lag || point.time == window_begin_) {
    least_ = point;
  }
  const double delay = line_.points().empty() ? least_.lag : std::min(line_.at(point.time), point.lag);
  offset_ns_ = base_ns_ + nanoseconds(delay - config_.latency_s);
  // The least delay is that of a stamp that lost nothing by being cut.
  return std::min(stamp_ns + offset_ns_ + nanoseconds(config_.resolution_s / 2), arrival_ns);
}

std::int64_t ReceiveTime::toVehicle(std::int64_t stamp_system_ns, std::int64_t system_ns,
                                    std::int64_t vehicle_ns) noexcept {
  if (!offset_ns_) drained(system_ns, vehicle_ns - kQueueSlack_ns);
  const std::int64_t oldest_ns = vehicle_ns - drained_ns_ + kQueueSlack_ns;
  const auto sensible = [&](std::int64_t age_ns) { return age_ns >= -kClockStep_ns && age_ns <= oldest_ns; };
  const auto at = [&](std::int64_t age_ns) { return vehicle_ns - (age_ns < 0 ? 0 : age_ns); };
  const std::int64_t age_now_ns = system_ns - stamp_system_ns;
  if (sensible(age_now_ns)) return at(age_now_ns);
  const std::int64_t age_before_ns = vehicle_ns + *offset_ns_ - stamp_system_ns;
  return sensible(age_before_ns) ? at(age_before_ns) : vehicle_ns;
}

void ReceiveTime::drained(std::int64_t system_ns, std::int64_t vehicle_ns) noexcept {
  const std::int64_t offset_ns = system_ns - vehicle_ns;
  const std::int64_t waited_ns = vehicle_ns - drained_ns_;
  // 0.1 % of the time between looks, twice what slewing can do.
  if (offset_ns_ && std::abs(offset_ns - *offset_ns_) > kClockStep_ns + waited_ns / 1000) ++steps_;
  offset_ns_ = offset_ns;
  drained_ns_ = vehicle_ns;
}

}  // namespace fathom::io

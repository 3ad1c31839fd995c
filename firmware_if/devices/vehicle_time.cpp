#include "firmware_if/devices/vehicle_time.hpp"

#include <cstdlib>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

// Slewing (adjtime, NTP) moves a clock by at most 0.5 ms a second; more between two looks is a step.
constexpr std::int64_t kClockStep_ns = kMillisecond_ns;
// A frame may have come this much before the queue was last looked at and found empty.
constexpr std::int64_t kQueueSlack_ns = 20 * kMillisecond_ns;

}  // namespace

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

#include <algorithm>
#include <cmath>

#include "sim/sensors/sensors.hpp"

namespace fathom::sim {

void simulateBattery(const SensorWorld& world, const BatteryConfig& config, LoggedSamples& samples) {
  constexpr double kSecondsPerHour = 3600;
  double charge = config.start_charge;
  const double step = 1 / config.rate_hz;
  for (std::int64_t i = 0; static_cast<double>(i) * step <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) * step;
    const double speed = world.trajectory.at(time).velocity_nav.norm();
    const double power = config.hotel_w + config.thrust_w_per_m3ps3 * std::pow(speed, 3);
    if (i > 0) charge = std::max(0.0, charge - power * step / kSecondsPerHour / config.capacity_wh);
    const double open_v = config.empty_v + (config.full_v - config.empty_v) * charge;
    BatterySample sample;
    sample.utc_ns = world.utcNs(time);
    sample.current = power / open_v;
    sample.voltage = open_v - *sample.current * config.resistance_ohm;
    sample.charge = charge;
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim

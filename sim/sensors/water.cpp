#include <algorithm>

#include "sim/scenario/random.hpp"
#include "sim/sensors/sensors.hpp"
#include "sim/sensors/water_properties.hpp"

namespace fathom::sim {

WaterPatches::WaterPatches(Random& random)
    : plankton(random, 0.2, 40.0, 400.0), sediment(random, 0.3, 20.0, 300.0) {}

void simulateWater(const SensorWorld& world, const WaterSensorConfig& config, LoggedSamples& samples) {
  if (config.rate_hz == 0) return;
  Random random(world.seed, "water");
  const WaterPatches patches(random);
  const double true_conductivity = conductivity(config.temperature_c, config.salinity_psu);
  const auto optical = [&](double mean, double patch) {
    return std::max(0.0, mean * (1.0 + patch + random.gauss(config.optics_relative_sigma)));
  };
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const double depth = world.trajectory.poseAt(time).translation().z();
    WaterSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.temperature = config.temperature_c + random.gauss(config.temperature_sigma_c);
    sample.conductivity = true_conductivity + random.gauss(config.conductivity_sigma);
    sample.sound_speed =
        soundSpeed(*sample.temperature, practicalSalinity(*sample.temperature, *sample.conductivity), depth);
    sample.chlorophyll = optical(config.chlorophyll_ug_l, patches.plankton.at(time));
    sample.cdom = optical(config.cdom_ppb, 0.5 * patches.plankton.at(time));
    sample.turbidity = optical(config.turbidity, patches.sediment.at(time));
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim

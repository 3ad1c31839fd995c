#include <cmath>
#include <numbers>

#include "sim/scenario/random.hpp"
#include "sim/sensors/sensors.hpp"

namespace fathom::sim {

double tideHeight(const TideConfig& tide, double time_s) {
  return tide.amplitude_m * std::sin(2.0 * std::numbers::pi * time_s / tide.period_s + tide.phase);
}

void simulateCompass(const SensorWorld& world, const CompassConfig& config, LoggedSamples& samples) {
  Random random(world.seed, "compass");
  const double roll_bias = random.gauss(config.tilt_bias_sigma);
  const double pitch_bias = random.gauss(config.tilt_bias_sigma);
  const double iron_phase = random.uniform(0.0, 2.0 * std::numbers::pi);
  // The deviation changes over minutes, as currents in the hull change.
  const SmoothNoise drift(random, config.drift_sigma, 120.0, 900.0);

  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const Eigen::Vector3d euler = (world.trajectory.poseAt(time) * world.T_body_compass).euler();
    AttitudeSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.roll = euler.x() + roll_bias + random.gauss(config.tilt_sigma);
    sample.pitch = euler.y() + pitch_bias + random.gauss(config.tilt_sigma);
    const double deviation = config.deviation * std::sin(euler.z() + iron_phase) + drift.at(time);
    double jumped = 0;
    for (const CompassJump& jump : config.jumps) jumped += time >= jump.at_s ? jump.turn : 0;
    const double heading =
        jumped + euler.z() - world.magnetic_declination + deviation + random.gauss(config.heading_sigma);
    sample.heading = heading - 2.0 * std::numbers::pi * std::floor(heading / (2.0 * std::numbers::pi));
    sample.magnetic = true;
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

void simulateDepth(const SensorWorld& world, const SensorsConfig& sensors, LoggedSamples& samples) {
  const DepthSensorConfig& config = sensors.depth;
  Random random(world.seed, "depth");
  const double scale = 1.0 + random.gauss(config.scale_error);
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const SE3 T_nav_depth = world.trajectory.poseAt(time) * world.T_body_depth;
    DepthSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.depth = (T_nav_depth.translation().z() + tideHeight(sensors.tide, time)) * scale +
                   random.gauss(config.sigma_m);
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim

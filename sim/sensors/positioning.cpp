#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/scenario/random.hpp"
#include "sim/sensors/sensors.hpp"

namespace fathom::sim {

namespace {

// The burst at this time; nullptr for none.
const UsblErrorBurst* burstAt(const std::vector<UsblErrorBurst>& bursts, double time_s) {
  for (const UsblErrorBurst& burst : bursts)
    if (burst.contains(time_s)) return &burst;
  return nullptr;
}

}  // namespace

void simulateUsbl(const SensorWorld& world, const UsblConfig& config, LoggedSamples& samples) {
  Random random(world.seed, "usbl");
  const LocalTransverseMercator mercator(world.origin);
  Random compass(world.seed, "usbl-ship");
  const SmoothNoise wobble(compass, config.heading_wobble, 60.0, 600.0);
  const double begin = compass.uniform(0.0, 2.0 * std::numbers::pi);
  // The transponder receives no pings while the vehicle floats.
  // NOLINTNEXTLINE(clang-analyzer-security.FloatLoopCounter): a time, not a count
  for (double time = world.trajectory.diveBegin() + config.period_s; time < world.trajectory.surfaced();
       time += config.period_s) {
    const double lap = begin + 2.0 * std::numbers::pi * time / config.ship_lap_s;
    const Eigen::Vector3d ship(config.ship_north_m + config.ship_circle_m * std::cos(lap),
                               config.ship_east_m + config.ship_circle_m * std::sin(lap),
                               config.ship_depth_m);
    Eigen::Vector3d target = (world.trajectory.poseAt(time) * world.T_body_usbl).translation();
    if (const UsblErrorBurst* other = burstAt(config.wrong_targets, time))
      target.head<2>() = Eigen::Vector2d(other->north_m, other->east_m);
    const Eigen::Vector3d line = target - ship;
    const double range_sigma = config.range_sigma_m + config.range_sigma_per_m * line.norm();
    const double range = line.norm() + random.gauss(range_sigma);
    const double bearing = std::atan2(line.y(), line.x()) + config.misalignment + wobble.at(time) +
                           random.gauss(config.angle_sigma);
    const double elevation =
        std::atan2(line.z(), line.head<2>().norm()) + config.bending + random.gauss(config.angle_sigma);
    const double horizontal = range * std::cos(elevation);
    Eigen::Vector2d north_east = ship.head<2>() +
                                 Eigen::Vector2d(config.offset_north_m, config.offset_east_m) +
                                 horizontal * Eigen::Vector2d(std::cos(bearing), std::sin(bearing));
    const bool outlier = random.uniform() < config.outlier_probability;
    const double direction = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double size = config.outlier_m * random.uniform(0.5, 1.5);
    if (outlier) north_east += size * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    if (const UsblErrorBurst* burst = burstAt(config.multipath, time))
      north_east += Eigen::Vector2d(burst->north_m, burst->east_m);
    const double delay = config.delay_s * random.uniform(0.6, 1.6);

    UsblFix fix;
    const Geodetic position = mercator.toGeodetic(north_east);
    fix.utc_ns = world.utcNs(time);
    fix.arrival_utc_ns = world.utcNs(time + delay);
    fix.latitude = position.latitude;
    fix.longitude = position.longitude;
    fix.depth = ship.z() + range * std::sin(elevation);
    // The ship's estimate for each component, without outliers.
    fix.sigma_horizontal =
        std::hypot(config.range_sigma_m, horizontal * config.angle_sigma) / std::numbers::sqrt2;
    samples.push_back({fix.arrival_utc_ns, fix});
  }
}

void simulateGps(const SensorWorld& world, const SensorsConfig& sensors, LoggedSamples& samples) {
  const GpsConfig& config = sensors.gps;
  const Waves waves = world.waves(sensors.waves);
  Random random(world.seed, "gps");
  const LocalTransverseMercator mercator(world.origin);
  const SmoothNoise north(random, config.drift_sigma_m, 60.0, 600.0);
  const SmoothNoise east(random, config.drift_sigma_m, 60.0, 600.0);
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    if (time >= world.trajectory.diveBegin() && time < world.trajectory.surfaced()) continue;
    const Eigen::Vector2d error(north.at(time) + random.gauss(config.sigma_m),
                                east.at(time) + random.gauss(config.sigma_m));
    const Eigen::Vector2d place = world.trajectory.poseAt(time).translation().head<2>();
    const Geodetic position = mercator.toGeodetic(place + waves.shiftAt(place, time) + error);
    GpsFix fix;
    fix.utc_ns = world.utcNs(time);
    fix.latitude = position.latitude;
    fix.longitude = position.longitude;
    fix.sigma_horizontal = std::hypot(config.drift_sigma_m, config.sigma_m);
    samples.push_back({world.utcNs(time + config.latency_s), fix});
  }
}

}  // namespace fathom::sim

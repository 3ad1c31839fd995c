#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "recon/geometry/geodesy.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sensors/sensors.hpp"

namespace fathom::sim {
namespace {

double headingError(const MagneticAnomaly& anomaly, const Eigen::Vector3d& place) {
  constexpr double kNearest = 0.5;  // radii
  const double down = anomaly.depth_m > 0 ? anomaly.depth_m - place.z() : anomaly.radius_m;
  const Eigen::Vector3d apart(place.x() - anomaly.north_m, place.y() - anomaly.east_m, down);
  return anomaly.turn / std::pow(std::max(apart.norm() / anomaly.radius_m, kNearest), 3);
}

// Roll and pitch error of a tilt sensor by the hull's acceleration [rad].
Eigen::Vector2d accelerationTilt(const SensorWorld& world, double share, double time_s) {
  if (share <= 0) return Eigen::Vector2d::Zero();
  constexpr double kHalf = 0.1, kGravity = 9.81;  // [s], [m/s^2]
  const Trajectory::State before = world.trajectory.at(time_s - kHalf),
                          after = world.trajectory.at(time_s + kHalf);
  const Eigen::Vector3d forwards = world.trajectory.poseAt(time_s).rotation().conjugate() *
                                   ((after.velocity_nav - before.velocity_nav) / (2 * kHalf));
  return share / kGravity * Eigen::Vector2d(-forwards.y(), forwards.x());
}

// Direction of the meridian in nav, from nav's north towards the east [rad].
double trueNorth(const LocalTransverseMercator& nav, const Eigen::Vector3d& place) {
  constexpr double kNorthwards = 1e-6;  // [rad], six metres
  Geodetic position = nav.toGeodetic(place.head<2>());
  const Eigen::Vector2d here = nav.toLocal(position);
  position.latitude += kNorthwards;
  const Eigen::Vector2d along = nav.toLocal(position) - here;
  return std::atan2(along.y(), along.x());
}

}  // namespace

double tideHeight(const TideConfig& tide, double time_s) {
  return tide.amplitude_m * std::sin(2.0 * std::numbers::pi * time_s / tide.period_s + tide.phase);
}

void simulateCompass(const SensorWorld& world, const CompassConfig& config, LoggedSamples& samples) {
  Random random(world.seed, "compass");
  const double roll_bias = random.gauss(config.tilt_bias_sigma);
  const double pitch_bias = random.gauss(config.tilt_bias_sigma);
  const double iron_phase = random.uniform(0.0, 2.0 * std::numbers::pi);
  // The deviation drifts over minutes with the currents in the hull.
  const SmoothNoise drift(random, config.drift_sigma, 120.0, 900.0);
  Random soft_iron(world.seed, "soft-iron");
  const double soft_phase = soft_iron.uniform(0.0, 2.0 * std::numbers::pi);
  const double filter_gain = 1 - std::exp(-1 / (config.rate_hz * config.lag_s));
  std::optional<Eigen::Quaterniond> lagged;
  const LocalTransverseMercator nav(world.origin);

  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const SE3 T_nav_compass = world.trajectory.poseAt(time) * world.T_body_compass;
    Eigen::Vector3d euler = T_nav_compass.euler();
    if (config.lag_s > 0) {
      lagged = lagged ? lagged->slerp(filter_gain, T_nav_compass.rotation()) : T_nav_compass.rotation();
      euler = SE3(*lagged, Eigen::Vector3d::Zero()).euler();
    }
    const Eigen::Vector2d tilt_error = accelerationTilt(world, config.acceleration_share, time);
    AttitudeSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.roll = euler.x() + tilt_error.x() + roll_bias + random.gauss(config.tilt_sigma);
    sample.pitch = euler.y() + tilt_error.y() + pitch_bias + random.gauss(config.tilt_sigma);
    const double deviation = config.deviation * std::sin(euler.z() + iron_phase) +
                             config.soft_iron * std::sin(2 * euler.z() + soft_phase) + drift.at(time);
    double disturbance = 0;
    for (const CompassJump& jump : config.jumps) disturbance += time >= jump.at_s ? jump.turn : 0;
    for (const MagneticAnomaly& anomaly : config.anomalies)
      disturbance += headingError(anomaly, T_nav_compass.translation());
    const double heading = disturbance + euler.z() - trueNorth(nav, T_nav_compass.translation()) -
                           world.magnetic_declination + deviation + random.gauss(config.heading_sigma);
    sample.heading = heading - 2.0 * std::numbers::pi * std::floor(heading / (2.0 * std::numbers::pi));
    sample.magnetic = true;
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

void simulateGyro(const SensorWorld& world, const GyroConfig& config, LoggedSamples& samples) {
  if (config.rate_hz == 0) return;
  Random random(world.seed, "gyro");
  const auto draw = [&](double sigma) {
    const double x = random.gauss(sigma), y = random.gauss(sigma), z = random.gauss(sigma);
    return Eigen::Vector3d(x, y, z);
  };
  const double white = config.angle_random_walk * std::sqrt(config.rate_hz);
  const double walk = config.bias_walk / std::sqrt(config.rate_hz);
  constexpr double kHalf = 1e-3;  // half the interval of the difference quotient [s]
  Eigen::Vector3d bias = draw(config.bias_sigma);
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const auto rotation = [&](double t) {
      return (world.trajectory.poseAt(t) * world.T_body_compass).rotation();
    };
    const Eigen::AngleAxisd turn(rotation(time - kHalf).conjugate() * rotation(time + kHalf));
    GyroSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.body_rate = turn.axis() * (turn.angle() / (2 * kHalf)) + bias + draw(white);
    bias += draw(walk);
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

void simulateDepth(const SensorWorld& world, const SensorsConfig& sensors, LoggedSamples& samples) {
  const DepthSensorConfig& config = sensors.depth;
  Random random(world.seed, "depth");
  const double scale = 1.0 + random.gauss(config.scale_error);
  const Waves waves = world.waves(sensors.waves);
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const SE3 T_nav_depth = world.trajectory.poseAt(time) * world.T_body_depth;
    double depth = T_nav_depth.translation().z() + tideHeight(sensors.tide, time);
    if (!waves.calm())
      depth += waves.pressureAt(T_nav_depth.translation(),
                                world.waterDepthAt(T_nav_depth.translation().head<2>()), time);
    DepthSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.depth = depth * scale + random.gauss(config.sigma_m);
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim

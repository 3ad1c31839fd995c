#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <utility>
#include <variant>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"

namespace fathom::nav::test {

inline constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // [ns]
inline std::int64_t at(double seconds) {
  return kStart + std::llround(seconds * 1e9);
}

// Pose of the body in nav at a time [s] since kStart.
using Path = std::function<SE3(double)>;

// A circle (radius 10 m, 1 m/s, through every heading) with rolling, pitching and heaving.
inline SE3 circle(double t) {
  const double radius = 10.0, rate = 0.1;  // [m], [rad/s]
  const double phase = rate * t;
  return SE3::fromEuler(3 * kRadiansPerDegree * std::sin(0.9 * t),
                        2 * kRadiansPerDegree * std::sin(0.7 * t + 1), phase + std::numbers::pi / 2,
                        {radius * std::cos(phase), radius * std::sin(phase), 20 + 0.3 * std::sin(0.5 * t)});
}

// A vehicle whose sensors are mounted away from its centre and askew, in
// water whose sound speed its DVL mistakes.
inline DeadReckoningConfig mountedConfig() {
  DeadReckoningConfig config;
  config.T_body_dvl =
      SE3::fromEuler(1 * kRadiansPerDegree, -2 * kRadiansPerDegree, 45 * kRadiansPerDegree, {-0.8, 0.1, 0.4});
  config.T_body_depth = SE3::fromEuler(0, 0, 0, {0.5, -0.2, -0.3});
  config.T_body_compass =
      SE3::fromEuler(2 * kRadiansPerDegree, 1 * kRadiansPerDegree, -90 * kRadiansPerDegree, {0.3, 0, 0});
  config.magnetic_declination = 12 * kRadiansPerDegree;
  config.sound_speed = 1530;
  return config;
}

// Noise-free samples of a path, in the order of their times.
struct Rates {
  double dvl = 5, attitude = 10, depth = 5;  // [Hz]
  double gyro = 0;                           // 0: none
};
using Sample = std::variant<DvlSample, AttitudeSample, DepthSample, WaterSample, GyroSample>;

inline DvlSample dvlAt(const Path& path, const DeadReckoningConfig& config, double t, double assumed = 1500) {
  const double h = 1e-4;  // [s] of the central difference: error about 1e-9 m/s here
  const Eigen::Vector3d velocity =
      (path(t + h) * config.T_body_dvl.translation() - path(t - h) * config.T_body_dvl.translation()) /
      (2 * h);
  DvlSample sample;
  sample.utc_ns = at(t);
  sample.velocity = (path(t) * config.T_body_dvl).rotation().conjugate() * velocity *
                    (assumed / config.sound_speed.value_or(assumed));
  sample.altitude = 2.0;
  sample.sound_speed = assumed;
  return sample;
}

inline AttitudeSample attitudeAt(const Path& path, const DeadReckoningConfig& config, double t) {
  const Eigen::Vector3d euler = (path(t) * config.T_body_compass).euler();
  return {at(t), euler.x(), euler.y(), wrapAngle(euler.z() - config.magnetic_declination), true};
}

// Rates about the compass's axes.
inline GyroSample gyroAt(const Path& path, const DeadReckoningConfig& config, double t) {
  const double h = 1e-4;  // [s]
  const auto rotation = [&](double when) { return (path(when) * config.T_body_compass).rotation(); };
  const Eigen::AngleAxisd turn(rotation(t - h).conjugate() * rotation(t + h));
  return {at(t), Eigen::Vector3d(turn.axis() * (turn.angle() / (2 * h))), {}};
}

inline DepthSample depthAt(const Path& path, const DeadReckoningConfig& config, double t) {
  return {at(t), (path(t) * config.T_body_depth.translation()).z()};
}

inline std::vector<Sample> samplesOf(const Path& path, const DeadReckoningConfig& config, double duration,
                                     const Rates& rates = {}) {
  std::vector<std::pair<double, Sample>> timed;
  for (int i = 0; i / rates.attitude < duration; ++i)
    timed.emplace_back(i / rates.attitude, attitudeAt(path, config, i / rates.attitude));
  // Off the attitude's times, as on a vehicle.
  for (int i = 0; 0.013 + i / rates.depth < duration; ++i)
    timed.emplace_back(0.013 + i / rates.depth, depthAt(path, config, 0.013 + i / rates.depth));
  for (int i = 0; 0.037 + i / rates.dvl < duration; ++i)
    timed.emplace_back(0.037 + i / rates.dvl, dvlAt(path, config, 0.037 + i / rates.dvl));
  for (int i = 0; rates.gyro > 0 && 0.007 + i / rates.gyro < duration; ++i)
    timed.emplace_back(0.007 + i / rates.gyro, gyroAt(path, config, 0.007 + i / rates.gyro));
  std::stable_sort(timed.begin(), timed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Sample> samples;
  for (auto& [t, sample] : timed) samples.push_back(sample);
  return samples;
}

inline void feed(DeadReckoning& nav, const Sample& sample) {
  std::visit([&](const auto& s) { nav.add(s); }, sample);
}
inline void feed(DeadReckoning& nav, const std::vector<Sample>& samples) {
  for (const Sample& sample : samples) feed(nav, sample);
}
inline std::int64_t timeOf(const Sample& sample) {
  return std::visit([](const auto& s) { return s.utc_ns; }, sample);
}

// Position error of a pose [m], given that odom's origin is under the path at the first ensemble (0.037 s).
inline double positionError(const SE3& T_odom_body, const Path& path, double t) {
  Eigen::Vector3d origin = path(0.037).translation();
  origin.z() = 0;
  return (T_odom_body.translation() - (path(t).translation() - origin)).norm();
}

}  // namespace fathom::nav::test

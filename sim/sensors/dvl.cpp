#include <algorithm>
#include <cmath>
#include <numbers>

#include "realtime/base/units.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sensors/sensors.hpp"

namespace fathom::sim {
namespace {

constexpr int kFewestBeams = 3;  // for a velocity

bool within(const std::vector<TimeSpan>& spells, double time_s) {
  return std::any_of(spells.begin(), spells.end(),
                     [time_s](const TimeSpan& s) { return s.contains(time_s); });
}

// Cosine of a beam's incidence on the seafloor, from two neighbouring rays.
double incidence(const SensorWorld& world, const Eigen::Vector3d& from, const Eigen::Vector3d& direction,
                 double range) {
  constexpr double kBeside = 0.02;  // [rad]
  const Eigen::Vector3d across = direction.unitOrthogonal(), along = direction.cross(across);
  Eigen::Vector3d edges[2];
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d beside = (direction + kBeside * (k == 0 ? across : along)).normalized();
    const auto hit = world.cast_ray(from, beside);
    if (!hit) return 0;
    edges[k] = *hit * beside - range * direction;
  }
  return std::abs(edges[0].cross(edges[1]).normalized().dot(direction));
}

}  // namespace

std::array<Eigen::Vector3d, 4> dvlBeams(double beam_angle) {
  std::array<Eigen::Vector3d, 4> beams;
  for (std::size_t i = 0; i < beams.size(); ++i) {
    const double azimuth = std::numbers::pi / 4.0 + static_cast<double>(i) * std::numbers::pi / 2.0;
    beams[i] = {std::sin(beam_angle) * std::cos(azimuth), std::sin(beam_angle) * std::sin(azimuth),
                std::cos(beam_angle)};
  }
  return beams;
}

void simulateDvl(const SensorWorld& world, const SensorsConfig& sensors, LoggedSamples& samples) {
  const SimulatedDvlConfig& config = sensors.dvl;
  Random random(world.seed, "dvl"), fish(world.seed, "dvl-fish");
  const Eigen::Vector3d current(config.current_north_mps, config.current_east_mps, 0);
  const bool any_slope = config.steepest > degreesToRadians(89.9);
  const double scale = 1.0 + random.uniform(-config.scale_error, config.scale_error);
  const auto beams = dvlBeams(config.beam_angle);
  int dropped = 0;  // ensembles left of a dropout
  DvlSample last;   // without faults

  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const Trajectory::State state = world.trajectory.at(time);
    const SE3 T_nav_dvl = state.T_nav_body * world.T_body_dvl;
    const double true_speed =
        soundSpeed(sensors.water.temperature_c, sensors.water.salinity_psu, T_nav_dvl.translation().z());
    // The instrument scales Doppler shift and travel time with the assumed speed of sound.
    const double sound_ratio = config.assumed_sound_speed_mps / true_speed;

    DvlSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.sound_speed = config.assumed_sound_speed_mps;
    // Every ensemble draws the same count of numbers: a dropout does not change the noise of the others.
    const Eigen::Vector3d noise(random.gauss(), random.gauss(), random.gauss());
    const Eigen::Vector4d range_noise(random.gauss(), random.gauss(), random.gauss(), random.gauss());
    const bool begins = random.uniform() < config.dropout_probability;
    const double length = -std::log(1.0 - random.uniform()) * config.dropout_length;
    if (dropped == 0 && begins) dropped = std::max(1, static_cast<int>(std::ceil(length)));
    double fish_at[4];  // distance of a fish over the beam's range; above 1: none
    for (double& part : fish_at) {
      const bool meets = fish.uniform() < config.fish_probability;
      part = fish.uniform(0.1, 0.95) + (meets ? 0 : 1);
    }
    const bool false_bottom = within(config.false_bottom, time);
    const bool lost = dropped > 0;
    if (lost) {
      --dropped;
    } else if (T_nav_dvl.translation().z() >= config.bubble_depth_m) {
      int locked = 0;
      double altitude = 0;
      for (std::size_t b = 0; b < beams.size(); ++b) {
        const Eigen::Vector3d direction = T_nav_dvl.rotation() * beams[b];
        const auto range = world.cast_ray(T_nav_dvl.translation(), direction);
        if (!range || *range < config.min_range_m || *range > config.max_range_m) continue;
        if (static_cast<int>(b) + 1 == config.dead_beam) continue;
        if (!any_slope &&
            incidence(world, T_nav_dvl.translation(), direction, *range) < std::cos(config.steepest))
          continue;
        constexpr double kLayer = 0.5;
        const double reached = std::min(fish_at[b], false_bottom ? kLayer : 1.0);
        const double measured =
            reached * *range * sound_ratio + config.range_sigma_m * range_noise[static_cast<Eigen::Index>(b)];
        sample.range[b] = measured * std::cos(config.beam_angle);
        altitude += measured * direction.z();
        ++locked;
      }
      if (locked >= kFewestBeams) {
        const Eigen::Vector3d bottom_velocity = false_bottom ? current : Eigen::Vector3d::Zero();
        const Eigen::Vector3d velocity_body =
            state.T_nav_body.rotation().conjugate() * (state.velocity_nav - bottom_velocity);
        const Eigen::Vector3d velocity_dvl =
            world.T_body_dvl.rotation().conjugate() *
            (velocity_body + state.rates_body.cross(world.T_body_dvl.translation()));
        sample.altitude = altitude / locked;
        const double sigma = config.velocity_sigma_mps + config.velocity_sigma_per_m * *sample.altitude;
        sample.velocity = velocity_dvl * sound_ratio * scale + sigma * noise;
      }
    }
    // Faults remove or replace measurements without changing the random numbers.
    if (within(config.outages, time)) continue;
    if (within(config.stuck, time)) {
      const std::int64_t stamp = sample.utc_ns;
      sample = last;
      sample.utc_ns = stamp;
    } else if (sample.velocity) {
      last = sample;
    }
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim

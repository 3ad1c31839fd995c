#include "sim/sensors/sensors.hpp"

#include <algorithm>
#include <cmath>

#include "firmware_if/files/images/image_file.hpp"

namespace fathom::sim {

std::int64_t SensorWorld::utcNs(double time_s) const {
  return start_utc_ns + static_cast<std::int64_t>(std::llround(time_s * 1e9));
}

double SensorWorld::waterDepthAt(const Eigen::Vector2d& place) const {
  constexpr double kNoBottom = 1000;  // [m]
  return cast_ray({place.x(), place.y(), 0}, Eigen::Vector3d::UnitZ()).value_or(kNoBottom);
}

Waves SensorWorld::waves(const WavesConfig& config) const {
  return {config, seed, waterDepthAt(trajectory.poseAt(0).translation().head<2>())};
}

std::vector<Exposure> simulateExposures(const SensorWorld& world, const CameraClockConfig& config) {
  std::vector<Exposure> exposures;
  constexpr double kRounding = 1e-6;  // [s]
  const double begin = world.trajectory.surveyBegin();
  for (int i = 0; begin + i / config.rate_hz < world.trajectory.surveyEnd() - kRounding; ++i) {
    const double time = begin + i / config.rate_hz;
    exposures.push_back({time, world.utcNs(time + config.left_offset_s + config.left_drift * time),
                         world.utcNs(time + config.right_offset_s + config.right_drift * time)});
  }
  return exposures;
}

namespace {

// As the vehicle's computer hands the samples of some sensors over.
void delay(const SensorWorld& world, const ArrivalConfig& config, LoggedSamples& samples) {
  Random random(world.seed, "arrival");
  for (io::LoggedSample& s : samples) {
    std::visit(
        [&](auto& sample) {
          using Sample = std::decay_t<decltype(sample)>;
          if constexpr (std::is_same_v<Sample, DvlSample> || std::is_same_v<Sample, AttitudeSample> ||
                        std::is_same_v<Sample, DepthSample>) {
            const double late = -config.jitter_s * std::log(1 - random.uniform());
            const double stamp = random.gauss(config.stamp_jitter_s);
            s.arrival_utc_ns += std::llround(1e9 * late);
            const std::int64_t batch = std::llround(1e9 * config.batch_s);
            if (batch > 0) s.arrival_utc_ns += batch - 1 - (s.arrival_utc_ns - 1) % batch;
            sample.utc_ns =
                std::min<std::int64_t>(sample.utc_ns + std::llround(1e9 * stamp), s.arrival_utc_ns);
          }
        },
        s.sample);
  }
}

}  // namespace

LoggedSamples simulateSensors(const SensorWorld& world, const SensorsConfig& config,
                              const std::vector<Exposure>& exposures) {
  LoggedSamples samples;
  simulateGps(world, config, samples);
  simulateUsbl(world, config.usbl, samples);
  simulateWater(world, config.water, samples);
  simulateBattery(world, config.battery, samples);
  simulateDepth(world, config, samples);
  simulateCompass(world, config.compass, samples);
  simulateGyro(world, config.gyro, samples);
  simulateDvl(world, config, samples);
  for (const Exposure& exposure : exposures) {
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      ImageEvent event;
      event.utc_ns = side == CameraSide::kLeft ? exposure.left_stamp_ns : exposure.right_stamp_ns;
      event.side = side;
      event.file_name = io::imageFileName(event.utc_ns, side);
      event.exposure_s = config.cameras.exposure_s * exposure.over_usual;
      samples.push_back({world.utcNs(exposure.time_s + config.cameras.latency_s), event});
    }
  }
  const ArrivalConfig& arrival = config.arrival;
  if (arrival.jitter_s > 0 || arrival.batch_s > 0 || arrival.stamp_jitter_s > 0)
    delay(world, arrival, samples);
  std::stable_sort(samples.begin(), samples.end(), [](const io::LoggedSample& a, const io::LoggedSample& b) {
    return a.arrival_utc_ns < b.arrival_utc_ns;
  });
  return samples;
}

}  // namespace fathom::sim

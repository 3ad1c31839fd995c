#pragma once

#include <limits>
#include <tuple>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::test {

// Samples of each kind, with each value present and absent, and times that need every nanosecond.
inline std::vector<SensorSample> everyKindOfSample() {
  constexpr std::int64_t kStart = 1'700'000'000'123'456'789;
  DvlSample whole{.utc_ns = kStart,
                  .velocity = Eigen::Vector3d(0.5123456789012345, -0.01, 1e-300),
                  .range = {2.1, 2.2, 2.3, 2.4},
                  .altitude = 1.987,
                  .sound_speed = 1522.25};
  DvlSample partial;
  partial.utc_ns = kStart + 1;
  partial.range[2] = 3.5;
  WaterSample water;
  water.utc_ns = kStart + 2;
  water.temperature = -1.5;
  water.turbidity = 0.0;
  WaterSample all_water{kStart + 3, 4.2, 18.5, 1515.0, 0.3, 2.0, 0.001};
  BatterySample battery{.utc_ns = kStart + 10, .voltage = {}, .current = {}, .charge = 0.875};
  return {whole,
          partial,
          AttitudeSample{kStart + 4, 0.01, -0.02, 6.1, true},
          AttitudeSample{kStart + 5, -0.01, 0.02, 0.1, false},
          DepthSample{kStart + 6, 23.456},
          UsblFix{kStart + 7, kStart + 2'000'000'007, -0.49, 2.01, 23.0, 0.35},
          GpsFix{std::numeric_limits<std::int64_t>::min(), -0.49, 2.01, 3.0},
          water,
          all_water,
          ImageEvent{kStart + 8, CameraSide::kLeft, "PR_20231114_221320_123_LC16.tif", 0.002},
          ImageEvent{kStart + 9, CameraSide::kRight, "PR_20231114_221320_123_RM16.tif", 0.0},
          battery,
          BatterySample{kStart + 11, 48.25, 4.5, 0.0},
          MissionProgressSample{kStart + 12, 0.375},
          GyroSample{kStart + 13, Eigen::Vector3d(0.01, -0.02, 0.3), {}},
          GyroSample{kStart + 14, {}, -0.25}};
}

inline auto fields(const DvlSample& s) {
  return std::tie(s.utc_ns, s.velocity, s.range, s.altitude, s.sound_speed);
}
inline auto fields(const AttitudeSample& s) {
  return std::tie(s.utc_ns, s.roll, s.pitch, s.heading, s.magnetic);
}
inline auto fields(const GyroSample& s) {
  return std::tie(s.utc_ns, s.body_rate, s.heading_rate);
}
inline auto fields(const DepthSample& s) {
  return std::tie(s.utc_ns, s.depth);
}
inline auto fields(const UsblFix& s) {
  return std::tie(s.utc_ns, s.arrival_utc_ns, s.latitude, s.longitude, s.depth, s.sigma_horizontal);
}
inline auto fields(const GpsFix& s) {
  return std::tie(s.utc_ns, s.latitude, s.longitude, s.sigma_horizontal);
}
inline auto fields(const WaterSample& s) {
  return std::tie(s.utc_ns, s.conductivity, s.temperature, s.sound_speed, s.chlorophyll, s.cdom, s.turbidity);
}
inline auto fields(const BatterySample& s) {
  return std::tie(s.utc_ns, s.voltage, s.current, s.charge);
}
inline auto fields(const MissionProgressSample& s) {
  return std::tie(s.utc_ns, s.fraction);
}
inline auto fields(const ImageEvent& s) {
  return std::tie(s.utc_ns, s.side, s.file_name, s.exposure_s);
}
inline bool same(const SensorSample& a, const SensorSample& b) {
  if (a.index() != b.index()) return false;
  return std::visit(
      [&](const auto& x) { return fields(x) == fields(std::get<std::decay_t<decltype(x)>>(b)); }, a);
}

}  // namespace fathom::test

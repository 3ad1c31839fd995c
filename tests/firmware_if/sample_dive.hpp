#pragma once

#include <limits>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::test {

// One sample of each kind and of each way to be absent, with times that need every nanosecond.
inline std::vector<SensorSample> everyKindOfSample() {
  constexpr std::int64_t kStart = 1'700'000'000'123'456'789;
  DvlSample whole;
  whole.utc_ns = kStart;
  whole.velocity = Eigen::Vector3d(0.5123456789012345, -0.01, 1e-300);
  whole.range = {2.1, 2.2, 2.3, 2.4};
  whole.altitude = 1.987;
  whole.sound_speed = 1522.25;
  DvlSample partial;
  partial.utc_ns = kStart + 1;
  partial.range[2] = 3.5;
  WaterSample water;
  water.utc_ns = kStart + 2;
  water.temperature = -1.5;
  water.turbidity = 0.0;
  WaterSample all_water{kStart + 3, 4.2, 18.5, 1515.0, 0.3, 2.0, 0.001};
  BatterySample battery;
  battery.utc_ns = kStart + 10;
  battery.charge = 0.875;
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

inline bool same(const DvlSample& a, const DvlSample& b) {
  return a.utc_ns == b.utc_ns && a.velocity == b.velocity && a.range == b.range && a.altitude == b.altitude &&
         a.sound_speed == b.sound_speed;
}
inline bool same(const AttitudeSample& a, const AttitudeSample& b) {
  return a.utc_ns == b.utc_ns && a.roll == b.roll && a.pitch == b.pitch && a.heading == b.heading &&
         a.magnetic == b.magnetic;
}
inline bool same(const GyroSample& a, const GyroSample& b) {
  return a.utc_ns == b.utc_ns && a.body_rate == b.body_rate && a.heading_rate == b.heading_rate;
}
inline bool same(const DepthSample& a, const DepthSample& b) {
  return a.utc_ns == b.utc_ns && a.depth == b.depth;
}
inline bool same(const UsblFix& a, const UsblFix& b) {
  return a.utc_ns == b.utc_ns && a.arrival_utc_ns == b.arrival_utc_ns && a.latitude == b.latitude &&
         a.longitude == b.longitude && a.depth == b.depth && a.sigma_horizontal == b.sigma_horizontal;
}
inline bool same(const GpsFix& a, const GpsFix& b) {
  return a.utc_ns == b.utc_ns && a.latitude == b.latitude && a.longitude == b.longitude &&
         a.sigma_horizontal == b.sigma_horizontal;
}
inline bool same(const WaterSample& a, const WaterSample& b) {
  return a.utc_ns == b.utc_ns && a.conductivity == b.conductivity && a.temperature == b.temperature &&
         a.sound_speed == b.sound_speed && a.chlorophyll == b.chlorophyll && a.cdom == b.cdom &&
         a.turbidity == b.turbidity;
}
inline bool same(const BatterySample& a, const BatterySample& b) {
  return a.utc_ns == b.utc_ns && a.voltage == b.voltage && a.current == b.current && a.charge == b.charge;
}
inline bool same(const MissionProgressSample& a, const MissionProgressSample& b) {
  return a.utc_ns == b.utc_ns && a.fraction == b.fraction;
}
inline bool same(const ImageEvent& a, const ImageEvent& b) {
  return a.utc_ns == b.utc_ns && a.side == b.side && a.file_name == b.file_name &&
         a.exposure_s == b.exposure_s;
}
inline bool same(const SensorSample& a, const SensorSample& b) {
  if (a.index() != b.index()) return false;
  return std::visit([&](const auto& x) { return same(x, std::get<std::decay_t<decltype(x)>>(b)); }, a);
}

}  // namespace fathom::test

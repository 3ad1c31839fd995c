#pragma once

#include <filesystem>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/files/sensor_log.hpp"

namespace fathom::sim {

constexpr std::int64_t kMissionNs = 1'772'330'400'000'000'000;  // 2026-03-01T02:00:00Z
constexpr std::int64_t kMillisecondNs = 1'000'000;
constexpr std::int64_t kSecondNs = 1000 * kMillisecondNs;

// Ten seconds of a dive without pictures in its img/: DVL at 5 Hz (first at 100 ms, 0.4 m/s forward), compass
// at 10 Hz (first at 0), a USBL fix at 3 s, pairs at 2 Hz from 1 s on whose left stamps are 20 ms behind, as
// mission.toml says.
inline void writeTenSecondMission(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "img");
  io::MissionConfig mission;
  mission.start_utc_ns = kMissionNs;
  mission.time_offsets.left_camera = 0.02;
  mission.cameras.left_serial = "A";
  mission.cameras.right_serial = "B";
  io::writeMissionConfig(folder, mission);
  const Camera camera{136, 102, 170, 170, 68, 51};
  writeStereoCalib(io::MissionPaths(folder).calib(),
                   {camera, camera, SE3::fromEuler(0, 0, 0, {-0.07, 0, 0})});

  io::SensorLogWriter log(io::MissionPaths(folder).log());
  for (int tick = 0; tick < 100; ++tick) {
    const std::int64_t now_ns = kMissionNs + tick * 100 * kMillisecondNs;
    AttitudeSample attitude;
    attitude.utc_ns = now_ns;
    attitude.heading = 0.01 * tick;
    log.write(now_ns + 5 * kMillisecondNs, attitude);
    if (tick % 2 == 1) {
      DvlSample dvl;
      dvl.utc_ns = now_ns;
      dvl.velocity = Eigen::Vector3d(0.4, 0.01, -0.02);
      dvl.range = {2.5, 2.6, 2.7, 2.8};
      log.write(now_ns + 60 * kMillisecondNs, dvl);
    }
    if (tick == 30) {
      UsblFix fix;
      fix.utc_ns = now_ns;
      fix.arrival_utc_ns = now_ns + 4 * kSecondNs;
      fix.latitude = -0.4;
      fix.longitude = 2.6;
      fix.depth = 12;
      fix.sigma_horizontal = 1.5;
      log.write(fix.arrival_utc_ns, fix);
    }
    if (tick >= 10 && tick % 5 == 0) {
      const std::string number = std::to_string(tick);
      log.write(now_ns + 80 * kMillisecondNs,
                ImageEvent{now_ns - 20 * kMillisecondNs, CameraSide::kLeft, "L" + number + ".tif", 0.002});
      log.write(now_ns + 90 * kMillisecondNs,
                ImageEvent{now_ns, CameraSide::kRight, "R" + number + ".tif", 0.002});
    }
  }
}

}  // namespace fathom::sim

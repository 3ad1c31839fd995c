#pragma once

#include <atomic>
#include <filesystem>
#include <string>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {

constexpr std::int64_t kMissionNs = 1'772'330'400'000'000'000;  // 2026-03-01T02:00:00Z
inline const std::atomic<bool> kNeverStop{false};

// Ten seconds of a dive without pictures in its img/: DVL at 5 Hz (first at 100 ms, 0.4 m/s forward), compass
// at 10 Hz (first at 0), a USBL fix at 3 s, pairs at 2 Hz from 1 s, left stamps 20 ms behind as in
// mission.toml.
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
    const std::int64_t now_ns = kMissionNs + tick * 100 * kMillisecond_ns;
    AttitudeSample attitude;
    attitude.utc_ns = now_ns;
    attitude.heading = 0.01 * tick;
    log.write(now_ns + 5 * kMillisecond_ns, attitude);
    if (tick % 2 == 1) {
      DvlSample dvl;
      dvl.utc_ns = now_ns;
      dvl.velocity = Eigen::Vector3d(0.4, 0.01, -0.02);
      dvl.range = {2.5, 2.6, 2.7, 2.8};
      log.write(now_ns + 60 * kMillisecond_ns, dvl);
    }
    if (tick == 30) {
      UsblFix fix;
      fix.utc_ns = now_ns;
      fix.arrival_utc_ns = now_ns + 4 * kSecond_ns;
      fix.latitude = -0.4;
      fix.longitude = 2.6;
      fix.depth = 12;
      fix.sigma_horizontal = 1.5;
      log.write(fix.arrival_utc_ns, fix);
    }
    if (tick >= 10 && tick % 5 == 0) {
      const std::string number = std::to_string(tick);
      log.write(now_ns + 80 * kMillisecond_ns,
                ImageEvent{now_ns - 20 * kMillisecond_ns, CameraSide::kLeft, "L" + number + ".tif", 0.002});
      log.write(now_ns + 90 * kMillisecond_ns,
                ImageEvent{now_ns, CameraSide::kRight, "R" + number + ".tif", 0.002});
    }
  }
}

}  // namespace fathom::sim

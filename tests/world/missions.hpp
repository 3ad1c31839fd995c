#pragma once

#include <Eigen/Geometry>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// A short straight dive over a textured, sloping plane, with exact sensors: a whole mission folder in a
// second.
struct TinyMission {
  int pairs = 8;
  double speed = 0.5;            // northwards [m/s]
  double first_north = 3.0;      // of the body at the first pair, in nav [m]
  double east = -2.0;            // [m]
  double body_depth = 10.0;      // [m]
  double seafloor_depth = 12.0;  // below nav's origin [m]
  double slope = 0.05;           // seafloor depth per metre north
  bool gps = true;

  static constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // of the log [ns]
  static constexpr double kFirstPair = 20.0;                         // after the start [s]

  [[nodiscard]] double seafloor(double north) const { return seafloor_depth + slope * north; }
  [[nodiscard]] double northAt(double t) const { return first_north + speed * (t - kFirstPair); }

  static StereoRig rig() {
    const Camera camera{340, 256, 428, 428, 169.5, 127.5};
    return {camera, camera, SE3::fromEuler(0, 0, 0, {-0.07, 0, 0})};
  }

  static double noise(int x, int y) {
    auto h = static_cast<std::uint32_t>(x) * 374761393U + static_cast<std::uint32_t>(y) * 668265263U;
    h = (h ^ h >> 13) * 1274126177U;
    return static_cast<double>((h ^ h >> 16) & 0xFFFF) / 65535.0;
  }
  // Reflectance: smooth noise of three scales down to a centimetre, so that corners are to be found.
  static double texture(double north, double east) {
    double sum = 0, amplitude = 0.5;
    for (const double cell : {0.08, 0.03, 0.012}) {
      const double x = north / cell, y = east / cell;
      const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
      const double u = x - i, v = y - j;
      sum += amplitude * ((1 - u) * ((1 - v) * noise(i, j) + v * noise(i, j + 1)) +
                          u * ((1 - v) * noise(i + 1, j) + v * noise(i + 1, j + 1)));
      amplitude *= 0.6;
    }
    return sum;
  }

  // 12 bits in 16, vignetted; `T_nav_cam` is the camera's own.
  [[nodiscard]] std::vector<std::uint16_t> render(const Camera& camera, const SE3& T_nav_cam) const {
    std::vector<std::uint16_t> pixels;
    for (int row = 0; row < camera.height; ++row) {
      for (int column = 0; column < camera.width; ++column) {
        const Eigen::Vector3d ray = T_nav_cam.rotation() * camera.ray(Eigen::Vector2d(column, row));
        const Eigen::Vector3d& c = T_nav_cam.translation();
        const double range = (seafloor(c.x()) - c.z()) / (ray.z() - slope * ray.x());
        const Eigen::Vector3d p = c + range * ray;
        const double r2 =
            std::pow((column - camera.cx) / camera.width, 2) + std::pow((row - camera.cy) / camera.height, 2);
        pixels.push_back(static_cast<std::uint16_t>(4095 * 0.8 * texture(p.x(), p.y()) * (1 - 0.8 * r2)));
      }
    }
    return pixels;
  }

  void write(const std::filesystem::path& folder) const {
    io::MissionConfig config;
    config.vehicle_name = "tiny";
    config.origin = {-0.5, 2.0};
    config.start_utc_ns = kStart;
    config.cameras.left_format = PixelFormat::kMono;
    // Looking down, top of the image forward: x of the camera to starboard, y aft.
    Eigen::Matrix3d down;
    down << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    config.T_body_cam = SE3(down, Eigen::Vector3d(0.2, -0.035, 0.1));
    config.T_body_dvl = SE3(Eigen::Quaterniond::Identity(), {-0.3, 0, 0.1});
    const std::filesystem::path images = io::MissionPaths(folder).images();
    std::filesystem::create_directories(images);
    io::writeMissionConfig(folder, config);
    const StereoRig cameras = rig();
    writeStereoCalib(io::MissionPaths(folder).calib(), cameras);

    io::SensorLogWriter log(io::MissionPaths(folder).log());
    const LocalTransverseMercator projection(config.origin);
    const double end = kFirstPair + pairs * 0.5 + 2;
    for (int tick = 0; tick < static_cast<int>(end * 10); ++tick) {
      const double t = tick * 0.1;
      const std::int64_t now = kStart + tick * 100'000'000LL;
      const double north = northAt(t);
      log.write(now, AttitudeSample{.utc_ns = now, .magnetic = false});
      log.write(now, DepthSample{now, body_depth});
      if (tick % 2 == 0) {
        DvlSample dvl;
        dvl.utc_ns = now;
        dvl.velocity = Eigen::Vector3d(speed, 0, 0);
        dvl.altitude = seafloor(north - 0.3) - (body_depth + 0.1);
        log.write(now, dvl);
      }
      if (gps && tick % 10 == 5 && t < 10) {
        const Geodetic g = projection.toGeodetic({north, east});
        log.write(now, GpsFix{now, g.latitude, g.longitude, 1.0});
      }
      const double since = t - kFirstPair;
      if (since >= -1e-6 && tick % 5 == 0 && std::lround(since * 2) < pairs) {
        const SE3 T_nav_cam =
            SE3(Eigen::Quaterniond::Identity(), {north, east, body_depth}) * config.T_body_cam;
        for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
          const bool left = side == CameraSide::kLeft;
          const Camera& camera = left ? cameras.left : cameras.right;
          const auto pixels = render(camera, left ? T_nav_cam : T_nav_cam * cameras.T_right_left.inverse());
          const std::string name = io::imageFileName(now, side);
          io::writeImage(images / name, {pixels.data(), camera.width, camera.height,
                                         static_cast<std::size_t>(camera.width) * 2, PixelFormat::kMono, 12});
          log.write(now, ImageEvent{now, side, name, 0.002});
        }
      }
    }
  }
};

}  // namespace fathom::test

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
    log.write(now_ns + 5 * kMillisecond_ns, AttitudeSample{.utc_ns = now_ns, .heading = 0.01 * tick});
    if (tick % 2 == 1) {
      DvlSample dvl;
      dvl.utc_ns = now_ns;
      dvl.velocity = Eigen::Vector3d(0.4, 0.01, -0.02);
      dvl.range = {2.5, 2.6, 2.7, 2.8};
      log.write(now_ns + 60 * kMillisecond_ns, dvl);
    }
    if (tick == 30) {
      UsblFix fix{.utc_ns = now_ns,
                  .arrival_utc_ns = now_ns + 4 * kSecond_ns,
                  .latitude = -0.4,
                  .longitude = 2.6,
                  .depth = 12,
                  .sigma_horizontal = 1.5};
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

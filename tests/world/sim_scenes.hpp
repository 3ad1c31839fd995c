#pragma once

#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>
#include <optional>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/sea/renderer.hpp"
#include "sim/sensors/sensors.hpp"
#include "sim/vehicle/vehicle.hpp"

namespace fathom::sim {

// Small scenes with predictable pictures.

inline constexpr double kDepth = 20.0;  // of the flat seafloors [m]

// Camera x to starboard, y aft, z down.
inline SE3 cameraInBody() {
  Eigen::Matrix3d r;
  r << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  return {r, Eigen::Vector3d::Zero()};
}

// A small rig with the distortion of a real survey camera behind a flat port.
inline StereoRig smallRig() {
  StereoRig rig;
  rig.left = rig.right = Camera{.width = 160,
                                .height = 120,
                                .fx = 200,
                                .fy = 202,
                                .cx = 77,
                                .cy = 61,
                                .k1 = 0.14,
                                .k2 = 0.6,
                                .p1 = 2e-3,
                                .p2 = -1e-3};
  rig.T_right_left =
      SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY())), {-0.07, 0.001, 0.0});
  return rig;
}

// The same cameras in air, behind thick ports at a distance and with tilted normals.
inline StereoRig behindFlatPorts(StereoRig rig) {
  double tilt = 0.03;
  for (Camera* camera : {&rig.left, &rig.right}) {
    FlatPort port{.air = *camera, .distance = 0.06, .glass = 0.02};
    port.air.fx /= port.water_index, port.air.fy /= port.water_index;
    port.normal = Eigen::Vector3d(tilt, -0.5 * tilt, 1).normalized();
    *camera = behindPort(port);
    tilt = -tilt;
  }
  return rig;
}

inline TerrainConfig flatSeafloor() {
  TerrainConfig config;
  config.size_north_m = config.size_east_m = 14.0;
  config.grid_spacing_m = 0.05;
  config.base_depth_m = kDepth;
  config.undulation_m = config.roughness_m = config.ripples.height_m = 0;
  config.rubble.density_per_m2 = config.boulders.density_per_m2 = config.corals.density_per_m2 = 0;
  config.detail_contrast = 0;
  return config;
}

// Writes a white square plate and gives the terrain that it makes, level at kDepth.
inline TerrainConfig whitePlate(const std::filesystem::path& folder, double size_m) {
  Mesh plate;
  const auto h = static_cast<float>(size_m / 2);
  plate.vertices = {{-h, -h, 0}, {-h, h, 0}, {h, h, 0}, {h, -h, 0}};
  plate.triangles = {{0, 1, 2}, {0, 2, 3}};
  plate.colours.assign(4, Rgb{255, 255, 255});
  writePly(folder / "plate.ply", plate);
  TerrainConfig config;
  config.kind = TerrainKind::kMesh;
  config.mesh_file = folder / "plate.ply";
  config.base_depth_m = kDepth;
  config.detail_contrast = 0;
  return config;
}

inline OpticsConfig monoOptics() {
  OpticsConfig optics;
  optics.sensor.left_format = optics.sensor.right_format = PixelFormat::kMono;
  return optics;
}

// No water, no vignetting, no blur: geometry and the inverse square alone.
inline OpticsConfig bareOptics() {
  OpticsConfig optics = monoOptics();
  optics.water = {{0, 0, 0}, {0, 0, 0}, 0};
  optics.sensor.vignetting_power = 0;
  optics.sensor.blur_sigma_px = 0;
  return optics;
}

inline SE3 above(double altitude_m) {
  return SE3::fromEuler(0, 0, 0, {0, 0, kDepth - altitude_m});
}

inline std::vector<float> electronsOf(const Renderer& renderer, const SE3& pose, CameraSide side,
                                      const PhotoConditions& conditions = {}) {
  std::vector<float> image(static_cast<std::size_t>(renderer.width(side) * renderer.height(side)));
  renderer.renderElectrons(pose, 0.0, side, image.data(), conditions);
  return image;
}

inline std::vector<std::uint16_t> imageOf(const Renderer& renderer, const SE3& pose, CameraSide side,
                                          std::uint64_t seed) {
  std::vector<std::uint16_t> image(static_cast<std::size_t>(renderer.width(side) * renderer.height(side)));
  renderer.render(pose, 1.5, side, seed, image.data());
  return image;
}

inline double centreLevel(const Renderer& renderer, const SE3& pose) {
  const std::vector<float> image = electronsOf(renderer, pose, CameraSide::kLeft);
  return image[static_cast<std::size_t>(60 * 160 + 77)];
}

inline constexpr double kSeafloor = 12.0;  // depth of the flat test seafloor [m]

inline std::optional<double> castFlat(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) {
  if (direction.z() <= 0) return std::nullopt;
  return (kSeafloor - from.z()) / direction.z();
}

// A dive of a few minutes over a flat seafloor.
class SensorTest : public ::testing::Test {
 protected:
  static SurveyPlan plan() { return SurveyPlan{.lines = 6, .line_length = 12, .cross_lines = 2}; }
  const Trajectory trajectory = simulateVehicle(
      plan(), VehicleConfig(), [](double, double) { return kSeafloor; }, 2);
  SensorWorld world(std::uint64_t seed = 7) const {
    return {trajectory,
            castFlat,
            {-0.4089, 2.6519},
            1772330400000000000,
            0.18,
            SE3::fromEuler(0.01, -0.02, 0.03, {-0.35, 0.0, 0.22}),
            SE3::fromEuler(0, 0, 0, {0.1, 0.0, -0.4}),
            SE3::fromEuler(0, 0, 0, {0.2, 0.1, -0.1}),
            SE3::fromEuler(0.003, 0.005, -0.009, {0.6, 0, -0.2}),
            seed};
  }
  // What a sensor gives in that dive.
  template <typename Sample, typename Config>
  std::vector<Sample> sampled(void (*simulate)(const SensorWorld&, const Config&, LoggedSamples&),
                              const Config& config, std::uint64_t seed = 7) const {
    LoggedSamples logged;
    simulate(world(seed), config, logged);
    std::vector<Sample> out;
    for (const auto& s : logged) out.push_back(std::get<Sample>(s.sample));
    return out;
  }
  double timeOf(std::int64_t utc_ns) const {
    return static_cast<double>(utc_ns - 1772330400000000000) * 1e-9;
  }
};

struct Statistics {
  double sum = 0, squares = 0;
  int count = 0;
  void add(double v) {
    sum += v;
    squares += v * v;
    ++count;
  }
  double mean() const { return sum / count; }
  double sigma() const { return std::sqrt(squares / count - mean() * mean()); }
};

}  // namespace fathom::sim

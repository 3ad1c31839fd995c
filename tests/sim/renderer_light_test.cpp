// Light, water and noise in rendered pictures.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "recon/geometry/ply_writer.hpp"
#include "sim/sea/appearance.hpp"
#include "sim/sea/light/water_light.hpp"
#include "tests/sim/renderer_scene.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

TEST(Renderer, LightFallsToAQuarterAtTwiceTheDistance) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = bareOptics();
  optics.strobes = {{{0, 0, 0}, {0, 0, 1}, 1.0, 0.7}};
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  EXPECT_NEAR(centreLevel(renderer, above(1.5)) / centreLevel(renderer, above(3.0)), 4.0, 0.01);
}

TEST(Beam, IsHalfAsStrongAtItsHalfAngle) {
  for (const double half_angle : {0.3, 0.7, 1.2})
    EXPECT_NEAR(
        static_cast<double>(Beam({{}, {0, 0, 1}, 3.0, half_angle})(static_cast<float>(std::cos(half_angle)))),
        1.5, 0.01);
}

TEST(Renderer, VignettingIsAPowerOfTheCosineOffTheAxis) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = bareOptics();
  const auto even =
      electronsOf(Renderer(terrain, optics, smallRig(), cameraInBody()), above(2), CameraSide::kLeft);
  optics.sensor.vignetting_power = 3;
  const auto dark =
      electronsOf(Renderer(terrain, optics, smallRig(), cameraInBody()), above(2), CameraSide::kLeft);
  for (const Eigen::Vector2i& pixel : {Eigen::Vector2i(5, 5), {77, 61}, {150, 100}, {20, 110}}) {
    const auto at = static_cast<std::size_t>(pixel.y() * 160 + pixel.x());
    const double cosine = smallRig().left.ray(pixel.cast<double>()).normalized().z();
    EXPECT_NEAR(static_cast<double>(dark[at] / even[at]), std::pow(cosine, 3), 1e-3);
  }
}

TEST(Renderer, BayerPixelsHaveTheirChannelsQuantumEfficiency) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = bareOptics();
  optics.sensor.left_format = PixelFormat::kBayerRggb;
  optics.sensor.quantum_efficiency = {0.5, 1.0, 0.8};
  const auto image =
      electronsOf(Renderer(terrain, optics, smallRig(), cameraInBody()), above(2), CameraSide::kLeft);
  const auto at = [&](int x, int y) {
    return static_cast<double>(image[static_cast<std::size_t>(y * 160 + x)]);
  };
  EXPECT_NEAR(at(76, 60) / at(77, 60), 0.5, 0.01);
  EXPECT_NEAR(at(77, 61) / at(77, 60), 0.8, 0.01);
}

// Independent sum: scattering * fraction / 2 pi of the light at every place on the ray is scattered back.
TEST(Renderer, BackscatterIsTheSumOverTheRay) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = bareOptics();
  optics.strobes = {{{0, 0.6, 0}, {0, 0, 1}, 1.0, 1.2}};
  optics.water = {{0.1, 0.1, 0.1}, {0.2, 0.2, 0.2}, 0};
  const StereoRig rig = smallRig();
  constexpr double kRange = 2, kLoss = 0.3, kFraction = 0.05;
  const double ground = centreLevel(Renderer(terrain, optics, rig, cameraInBody()), above(kRange));
  optics.water.backscatter_fraction = kFraction;
  const double both = centreLevel(Renderer(terrain, optics, rig, cameraInBody()), above(kRange));
  const double power = std::log(0.5) / std::log(std::cos(1.2));
  const auto lit = [&](double t) {  // irradiance times transmission back, at t down the axis
    const double d = std::hypot(t, 0.6);
    return std::pow(t / d, power) / (d * d) * std::exp(-kLoss * (d + t));
  };
  double water = 0;
  constexpr int kSteps = 20000;
  for (int k = 0; k < kSteps; ++k) water += lit((k + 0.5) * kRange / kSteps) * kRange / kSteps;
  water *= 0.2 * kFraction / (2 * std::numbers::pi);
  const double plate = lit(kRange) * kRange / std::hypot(kRange, 0.6) / std::numbers::pi;
  EXPECT_NEAR((both - ground) / ground, water / plate, 0.02 * water / plate);
}

TEST(Appearance, IsWhatPhotographsShowOnceTheirLightIsTakenOut) {
  TerrainConfig config = flatSeafloor();
  config.detail_contrast = 0.22;
  const SeaTerrain grainy(config);
  config.detail_contrast = 0;
  const SeaTerrain smooth(config);
  OpticsConfig optics = bareOptics();
  optics.strobes = {{{0, 0, 0}, {0, 0, 1}, 1.0, 1.2}};
  const StereoRig rig = smallRig();
  const SE3 pose = above(0.3);  // near enough for grains of 1.5 mm
  const auto with = electronsOf(Renderer(grainy, optics, rig, cameraInBody()), pose, CameraSide::kLeft);
  const auto without = electronsOf(Renderer(smooth, optics, rig, cameraInBody()), pose, CameraSide::kLeft);
  const Appearance look_grainy(grainy), look_smooth(smooth);
  const auto mono = [&](const Appearance& appearance, const Eigen::Vector3d& ray) {
    const auto seen = appearance.look(pose.translation(), ray, 0.3 / rig.left.fx).value();
    const auto& q = optics.sensor.quantum_efficiency;
    double sum = 0;
    for (std::size_t c = 0; c < 3; ++c) sum += q[c] * static_cast<double>(seen.albedo[c]);
    return sum * static_cast<double>(seen.facing);
  };
  double aa = 0, bb = 0, ab = 0;
  for (int y = 20; y < 100; ++y) {
    for (int x = 20; x < 140; ++x) {
      const auto at = static_cast<std::size_t>(y * 160 + x);
      const Eigen::Vector3d ray = (pose * cameraInBody()).rotation() * rig.left.ray({x, y});
      const double shown = static_cast<double>(with[at]) / static_cast<double>(without[at]) - 1;
      const double predicted = mono(look_grainy, ray) / mono(look_smooth, ray) - 1;
      aa += shown * shown;
      bb += predicted * predicted;
      ab += shown * predicted;
    }
  }
  EXPECT_GT(std::sqrt(bb / (80 * 120)), 0.05) << "grains are seen";
  EXPECT_GT(ab / std::sqrt(aa * bb), 0.98);
  EXPECT_NEAR(std::sqrt(aa / bb), 1.0, 0.05);
}

TEST(Renderer, AWhiteSeafloorAtTheReferenceDistanceGetsTheConfiguredExposure) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = monoOptics();
  optics.water.backscatter_fraction = 0;
  optics.sensor.exposure = 0.8;
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  EXPECT_NEAR(centreLevel(renderer, above(2.0)), 0.8 * optics.sensor.full_well_electrons,
              0.01 * optics.sensor.full_well_electrons);
}

TEST(Renderer, WaterTakesRedBeforeGreenAndBlueByBeersLaw) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = bareOptics();
  optics.sensor.left_format = PixelFormat::kBayerRggb;
  optics.sensor.quantum_efficiency = {1, 1, 1};
  optics.strobes = {{{0, 0, 0}, {0, 0, 1}, 1.0, 1.2}};
  optics.water.absorption_per_m = {0.4, 0.1, 0.05};
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  const std::vector<float> image = electronsOf(renderer, above(2.0), CameraSide::kLeft);
  const auto at = [&](int x, int y) {
    return static_cast<double>(image[static_cast<std::size_t>(y * 160 + x)]);
  };
  const double red = at(76, 60), green = 0.5 * (at(77, 60) + at(76, 61)), blue = at(77, 61);
  EXPECT_LT(red, green);
  EXPECT_LT(green, blue);
  EXPECT_NEAR(red / green, std::exp(-0.3 * 4.0), 0.01);  // two metres down, two up
  EXPECT_NEAR(green / blue, std::exp(-0.05 * 4.0), 0.01);
}

TEST(Renderer, ThingsCastAShadowOfTheNearStrobe) {
  const test::TemporaryFolder folder;
  Mesh plate;  // a large plate, and a small one half a metre over it
  for (const auto& [half, z] : {std::pair(8.0F, 0.0F), std::pair(0.15F, -0.5F)}) {
    const auto first = static_cast<std::uint32_t>(plate.vertices.size());
    for (const auto& [x, y] :
         {std::pair(-half, -half), std::pair(-half, half), std::pair(half, half), std::pair(half, -half)})
      plate.vertices.emplace_back(x, y, z);
    plate.triangles.push_back({first, first + 1, first + 2});
    plate.triangles.push_back({first, first + 2, first + 3});
  }
  writePly(folder.path() / "plates.ply", plate);
  TerrainConfig config;
  config.kind = TerrainKind::kMesh;
  config.mesh_file = folder.path() / "plates.ply";
  config.detail_contrast = 0;
  const SeaTerrain terrain(config);  // the mean vertex is at base_depth_m: the plates at +-0.25 m
  const double altitude = 2.0;
  OpticsConfig optics = bareOptics();
  optics.strobes = {{{1.0, 0, 0}, {0, 0, 1}, 1.0, 1.2}};
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  const SE3 pose = SE3::fromEuler(0, 0, 0, {0, 0, config.base_depth_m + 0.25 - altitude});
  const std::vector<float> image = electronsOf(renderer, pose, CameraSide::kLeft);
  const auto level = [&](double north, double east) {
    const Eigen::Vector2d pixel = smallRig().left.project(
        (pose * cameraInBody()).inverse() * Eigen::Vector3d(north, east, config.base_depth_m + 0.25));
    return image[static_cast<std::size_t>(std::lround(pixel.y()) * 160 + std::lround(pixel.x()))];
  };
  // The strobe is 1 m ahead and 1.5 m over the small plate: the shadow moves 0.5 m / 1.5 m * 1 m astern.
  EXPECT_EQ(level(-0.4, 0.0), 0.0F);
  EXPECT_GT(level(-0.4, 0.35), 100.0F);
  EXPECT_GT(level(0.4, 0.0), 100.0F);
}

TEST(Renderer, OpenWaterShowsOnlyBackscatterBrighterTowardsTheStrobes) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 0.1));
  OpticsConfig optics = monoOptics();
  optics.strobes = {{{0.75, 0, 0}, {-0.2, 0, 1}, 1.0, 0.7}};
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  const std::vector<float> image =
      electronsOf(renderer, SE3::fromEuler(0, 0, 0, {50, 50, 10}), CameraSide::kLeft);
  const float ahead = image[static_cast<std::size_t>(5 * 160 + 80)],
              astern = image[static_cast<std::size_t>(115 * 160 + 80)];
  EXPECT_GT(astern, 0.0F);
  EXPECT_GT(ahead, 1.2F * astern);
  EXPECT_LT(ahead, 0.2F * static_cast<float>(optics.sensor.full_well_electrons));
}

TEST(Renderer, NoiseHasTheVarianceOfShotAndReadNoise) {
  const test::TemporaryFolder folder;
  const SeaTerrain terrain(whitePlate(folder.path(), 20.0));
  OpticsConfig optics = monoOptics();
  optics.sensor.exposure = 0.5;
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  const std::vector<float> electrons = electronsOf(renderer, above(2.0), CameraSide::kLeft);
  const double gain = 4095 / optics.sensor.full_well_electrons;
  double sum = 0, sum_squares = 0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const std::vector<std::uint16_t> image = imageOf(renderer, above(2.0), CameraSide::kLeft, seed);
    for (std::size_t i = 0; i < image.size(); ++i) {
      const double model = electrons[i] + std::pow(optics.sensor.read_noise_electrons, 2);
      const double residual = image[i] - optics.sensor.black_level * 4095 - electrons[i] * gain;
      const double scaled = residual / std::sqrt(model * gain * gain + 1.0 / 12);
      sum += scaled, sum_squares += scaled * scaled;
      ++count;
    }
  }
  const double sigma_of_mean = 1 / std::sqrt(count);
  EXPECT_NEAR(sum / count, 0.0, 5 * sigma_of_mean);
  EXPECT_NEAR(sum_squares / count, 1.0, 5 * std::numbers::sqrt2 * sigma_of_mean);
}

TEST(Renderer, EightBitsHoldTheSamePictureAndNoiseSeedsDiffer) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = monoOptics();
  const Renderer twelve(terrain, optics, smallRig(), cameraInBody());
  optics.sensor.bits = 8;
  const Renderer eight(terrain, optics, smallRig(), cameraInBody());
  const auto fine = imageOf(twelve, above(2.0), CameraSide::kLeft, 3);
  const auto coarse = imageOf(eight, above(2.0), CameraSide::kLeft, 3);
  for (std::size_t i = 0; i < fine.size(); ++i) ASSERT_NEAR(coarse[i], fine[i] * 255.0 / 4095.0, 1.0);
  EXPECT_NE(fine, imageOf(twelve, above(2.0), CameraSide::kLeft, 4));
}

}  // namespace
}  // namespace fathom::sim

#include "sim/sea/renderer.hpp"
#include <gtest/gtest.h>
#include "recon/geometry/ply.hpp"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "sim/sea/light/water_light.hpp"
#include "sim/sea/renderer.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/sim_scenes.hpp"

namespace fathom::sim {
namespace {

TEST(Renderer, ATexturedPointAppearsWhereTheCameraModelProjectsIt) {
  const test::TemporaryFolder folder;
  // A dark plate with a white disc painted on it, off the axis, where the distortion moves it by pixels.
  constexpr int kTexels = 1024;
  constexpr double kSize = 2.0;  // [m]
  cv::Mat painting(kTexels, kTexels, CV_8UC3, cv::Scalar::all(0));
  cv::circle(painting, {400 * 16, 640 * 16}, 26 * 16, cv::Scalar::all(255), cv::FILLED, cv::LINE_AA, 4);
  cv::imwrite(folder.path() / "disc.png", painting);
  TerrainConfig terrain_config = whitePlate(folder.path(), kSize);
  Mesh plate = readPly(terrain_config.mesh_file);
  plate.texture_coordinates.clear();
  for (const auto& v : plate.vertices)  // s along east, t along north
    plate.texture_coordinates.emplace_back(v.y() / kSize + 0.5, v.x() / kSize + 0.5);
  writePly(terrain_config.mesh_file, plate);
  terrain_config.texture_file = folder.path() / "disc.png";
  const SeaTerrain terrain(terrain_config);
  const double east = ((400 + 0.5) / kTexels - 0.5) * kSize, north = (0.5 - (640 + 0.5) / kTexels) * kSize;

  OpticsConfig optics = bareOptics();
  optics.strobes = {{{0, 0, -1.5}, {0, 0, 1}, 1.0, 1.2}};
  optics.sensor.blur_sigma_px = 0.6;
  const SE3 pose = SE3::fromEuler(0.05, -0.04, 0.3, {0.1, -0.05, kDepth - 2.0});
  const Eigen::Vector3d in_left = (pose * cameraInBody()).inverse() * Eigen::Vector3d(north, east, kDepth);
  for (const StereoRig& rig : {smallRig(), behindFlatPorts(smallRig())}) {
    const Renderer renderer(terrain, optics, rig, cameraInBody());
    for (CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const Camera& camera = side == CameraSide::kLeft ? rig.left : rig.right;
      const Eigen::Vector2d expected =
          camera.project(side == CameraSide::kLeft ? in_left : rig.T_right_left * in_left);
      ASSERT_TRUE(camera.contains(expected, 10));
      const std::vector<float> image = electronsOf(renderer, pose, side);
      double sum = 0;
      Eigen::Vector2d centroid(0, 0);
      for (int y = 0; y < camera.height; ++y) {
        for (int x = 0; x < camera.width; ++x) {
          const double value = image[static_cast<std::size_t>(y * camera.width + x)];
          sum += value;
          centroid += value * Eigen::Vector2d(x, y);
        }
      }
      centroid /= sum;
      EXPECT_NEAR(centroid.x(), expected.x(), 0.1);
      EXPECT_NEAR(centroid.y(), expected.y(), 0.1);
    }
  }
}

TEST(Renderer, LeftAndRightShowTheSameTextureAtTheTrueDisparity) {
  TerrainConfig config = flatSeafloor();
  config.detail_contrast = 0.22;
  const SeaTerrain terrain(config);
  StereoRig rig;
  rig.left = rig.right = Camera{.width = 200, .height = 120, .fx = 800, .fy = 800, .cx = 100, .cy = 60};
  rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  const Renderer renderer(terrain, monoOptics(), rig, cameraInBody());
  const double altitude = 2.0, disparity = 800 * 0.07 / altitude;  // 28 px
  const auto toMat = [&](CameraSide side) {
    const std::vector<float> image = electronsOf(renderer, above(altitude), side);
    return cv::Mat(120, 200, CV_32F, const_cast<float*>(image.data())).clone();
  };
  const cv::Mat left = toMat(CameraSide::kLeft), right = toMat(CameraSide::kRight);
  // A patch of the left is best matched in the right at the disparity, to a tenth of a pixel by a parabola.
  for (const cv::Point corner : {cv::Point(60, 20), cv::Point(120, 50), cv::Point(150, 80)}) {
    const cv::Mat patch = left(cv::Rect(corner.x, corner.y, 31, 25));
    cv::Scalar mean, sigma;
    cv::meanStdDev(patch, mean, sigma);
    EXPECT_GT(sigma[0] / mean[0], 0.05) << "too flat to match";
    cv::Mat score;
    cv::matchTemplate(right(cv::Rect(0, corner.y, 200, 25)), patch, score, cv::TM_CCOEFF_NORMED);
    cv::Point best;
    double value = 0;
    cv::minMaxLoc(score, nullptr, &value, nullptr, &best);
    EXPECT_GT(value, 0.99);
    ASSERT_GT(best.x, 0);
    const double a = score.at<float>(0, best.x - 1), b = score.at<float>(0, best.x),
                 c = score.at<float>(0, best.x + 1);
    const double peak = best.x + 0.5 * (a - c) / (a - 2 * b + c);
    EXPECT_NEAR(corner.x - peak, disparity, 0.1);
  }
}

TEST(Renderer, TheBytesDoNotDependOnTheNumberOfThreads) {
  TerrainConfig config;
  config.size_north_m = config.size_east_m = 5.0;
  config.grid_spacing_m = 0.04;
  config.corals.density_per_m2 = 0.4;
  config.fish = 6;
  config.swaying_density_per_m2 = 0.5;
  const SE3 pose = SE3::fromEuler(0.03, 0.02, 0.4, {0.2, 0.1, kDepth - 2.0});
  const auto bytes = [&](int threads) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            static_cast<std::size_t>(threads));
    oneapi::tbb::task_arena arena(threads);
    return arena.execute([&] {
      const SeaTerrain terrain(config);
      const Renderer renderer(terrain, OpticsConfig(), smallRig(), cameraInBody());
      return imageOf(renderer, pose, CameraSide::kLeft, 7);
    });
  };
  const std::vector<std::uint16_t> one = bytes(1);
  EXPECT_EQ(one, bytes(2));
  EXPECT_GT(*std::max_element(one.begin(), one.end()), 400);
}

TEST(Renderer, SwayingBladesMoveAndTheSeafloorDoesNot) {
  TerrainConfig config = flatSeafloor();
  const auto change = [](const SeaTerrain& terrain) {
    const Renderer renderer(terrain, monoOptics(), smallRig(), cameraInBody());
    std::vector<float> early(160 * 120), late(160 * 120);
    renderer.renderElectrons(above(2.0), 0.0, CameraSide::kLeft, early.data());
    renderer.renderElectrons(above(2.0), 1.7, CameraSide::kLeft, late.data());
    return early != late;
  };
  EXPECT_FALSE(change(SeaTerrain(config)));
  config.swaying_density_per_m2 = 8;
  EXPECT_TRUE(change(SeaTerrain(config)));
}

TEST(Renderer, OpticsOutOfRangeAreRefusedByName) {
  const SeaTerrain terrain(flatSeafloor());
  const auto make = [&](auto change) {
    OpticsConfig optics;
    change(optics);
    const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  };
  EXPECT_THROW(make([](OpticsConfig& o) { o.sensor.bits = 10; }), std::invalid_argument);
  EXPECT_THROW(make([](OpticsConfig& o) { o.strobes.clear(); }), std::invalid_argument);
  EXPECT_THROW(make([](OpticsConfig& o) { o.water.absorption_per_m[0] = std::nan(""); }),
               std::invalid_argument);
  EXPECT_THROW(make([](OpticsConfig& o) {
                 o.strobes = {{{0, 0, 5}, {0, 0, 1}, 1, 0.5}};
               }),
               std::invalid_argument);
}

// Light, water and noise in rendered pictures.

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

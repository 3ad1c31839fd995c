#include "sim/sea/renderer.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "recon/geometry/ply_writer.hpp"

#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/sim/renderer_scene.hpp"
#include "tests/support/test_data.hpp"

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

}  // namespace
}  // namespace fathom::sim

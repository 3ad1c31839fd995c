// What makes a sea hard: each key does what its documentation says, and nothing else.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "realtime/base/numbers/order_statistics.hpp"
#include "sim/sea/ground/texture_image.hpp"
#include "sim/sea/light/daylight.hpp"
#include "sim/sea/light/lens.hpp"
#include "sim/sea/light/marine_snow.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/sim_scenes.hpp"

namespace fathom::sim {
namespace {

constexpr int kWide = 160, kHigh = 120;

double mean(const std::vector<float>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

std::vector<float> lit(const Renderer& renderer, const PhotoConditions& moment, double altitude_m = 2) {
  return electronsOf(renderer, above(altitude_m), CameraSide::kLeft, moment);
}

TEST(MarineSnow, HasTheNumbersAndTheSizesThatItsKeysSay) {
  WaterConfig water{.snow_per_m3 = 2000, .snow_slope = 4};
  std::size_t count = 0, large = 0;
  constexpr int kPairs = 20;
  const Camera camera = smallRig().left;
  for (int pair = 0; pair < kPairs; ++pair)
    for (const Speck& s : marineSnow(water, camera, static_cast<std::uint64_t>(pair))) {
      if (s.position.z() > 2 || std::abs(s.position.x() / s.position.z()) > 0.4F ||
          std::abs(s.position.y() / s.position.z()) > 0.3F)
        continue;
      ++count;
      large += s.diameter > 1e-3F ? 1 : 0;
    }
  const double volume = 4 * 0.4 * 0.3 * (std::pow(2, 3) - std::pow(0.1, 3)) / 3;
  EXPECT_NEAR(static_cast<double>(count) / (kPairs * volume * 2000), 1, 0.02);
  EXPECT_NEAR(static_cast<double>(large) / static_cast<double>(count), 1.0 / 8, 0.01) << "d^-4: a cube above";
}

TEST(MarineSnow, IsSeenByBothCamerasAtItsOwnDepth) {
  const StereoRig rig = smallRig();
  OpticsConfig lamps = bareOptics();
  lamps.strobes = {{{0, 0.3, 0}, {0, 0, 1}, 1.0, 0.7}};
  const WaterAttenuation attenuation(lamps.water);
  const std::vector<Beam> beams(lamps.strobes.begin(), lamps.strobes.end());
  const std::vector<Speck> one{{{0.05F, 0.02F, 1.2F}, 0.004F}};
  const SE3 T_body_right = cameraInBody() * rig.T_right_left.inverse();
  const auto left = visibleSpecks(one, lamps, attenuation, beams, rig.left, cameraInBody(), cameraInBody()),
             right = visibleSpecks(one, lamps, attenuation, beams, rig.right, T_body_right, cameraInBody());
  ASSERT_EQ(left.size(), 1u);
  ASSERT_EQ(right.size(), 1u);
  Eigen::Vector3d point;
  double gap = 0;
  ASSERT_TRUE(triangulatePixels(rig, {static_cast<double>(left[0].x), static_cast<double>(left[0].y)},
                                {static_cast<double>(right[0].x), static_cast<double>(right[0].y)}, point,
                                gap));
  EXPECT_LT((point - Eigen::Vector3d(0.05, 0.02, 1.2)).norm(), 1e-3);
  EXPECT_EQ(left[0].radius, 0.5F) << "two thirds of a pixel fill part of one";
  EXPECT_NEAR(static_cast<double>(left[0].cover), std::pow(0.004 * 201 / 1.2, 2), 0.01);
}

TEST(Renderer, MarineSnowHidesBehindTheGroundAndShinesBeforeIt) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = bareOptics();
  const auto clear = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), {});
  optics.water.snow_per_m3 = 3000;
  const Renderer snowy(terrain, optics, smallRig(), cameraInBody());
  PhotoConditions one, other;
  one.snow_seed = 1, other.snow_seed = 2;
  const auto a = lit(snowy, one), b = lit(snowy, other), again = lit(snowy, one);
  EXPECT_EQ(a, again);
  const auto changed = [&](const std::vector<float>& image) {
    int n = 0;
    for (std::size_t k = 0; k < image.size(); ++k) n += image[k] > 1.05F * clear[k] ? 1 : 0;
    return n;
  };
  EXPECT_GT(changed(a), 30);
  EXPECT_GT(changed(b), 30);
  EXPECT_NE(a, b);
}

TEST(LensBlur, ForwardScatterKeepsTheLightAndLowersTheContrast) {
  std::vector<float> image(kWide * kHigh, 1.0F);
  for (int y = 0; y < kHigh; ++y)
    for (int x = kWide / 2; x < kWide; ++x) image[static_cast<std::size_t>(y * kWide + x)] = 3.0F;
  const double before = mean(image);
  const std::vector<float> two_metres(image.size(), 0.5F);
  forwardScatter({image, kWide, kHigh, 1}, two_metres, 0.2, 10);
  EXPECT_NEAR(mean(image), before, 1e-3);
  // Beside the edge half of what is spread comes from the other side.
  const double spread = 1 - std::exp(-0.2 * 2);
  EXPECT_NEAR(static_cast<double>(image[60 * kWide + 79]), 1 + 0.5 * spread * 2, 0.06);
  EXPECT_NEAR(static_cast<double>(image[60 * kWide + 20]), 1, 1e-3);
}

// Standard deviation of the image of a point [px].
double width(const std::vector<float>& image) {
  double sum = 0, xx = 0;
  for (int y = 0; y < kHigh; ++y)
    for (int x = 0; x < kWide; ++x) {
      const auto v = static_cast<double>(image[static_cast<std::size_t>(y * kWide + x)]);
      sum += v, xx += v * (x - 80) * (x - 80);
    }
  return std::sqrt(xx / sum);
}

std::vector<float> point() {
  std::vector<float> image(kWide * kHigh, 0.0F);
  image[60 * kWide + 80] = 1;
  return image;
}

TEST(LensBlur, DefocusGrowsAwayFromTheFocus) {
  for (const double range : {1.0, 1.5, 2.0, 3.0, 6.0}) {
    std::vector<float> image = point();
    const std::vector<float> inverse(image.size(), static_cast<float>(1 / range));
    constexpr double kAperture = 20;  // [px m]
    defocus({image, kWide, kHigh, 1}, inverse, kAperture, 2);
    const double disc = kAperture * std::abs(1 / range - 0.5);
    EXPECT_NEAR(width(image), disc / 4, 0.03 + 0.03 * disc) << range;  // of a disc: a quarter of its diameter
  }
}

TEST(LensBlur, MotionBlursAPointAlongItsPath) {
  std::vector<float> image = point();
  motionBlur({image, kWide, kHigh, 1}, [](int, int) { return Eigen::Vector2f(6, 0); });
  EXPECT_NEAR(width(image), 6 / std::sqrt(12.0), 0.15);
  EXPECT_NEAR(mean(image) * kWide * kHigh, 1, 1e-3);
  EXPECT_EQ(image[61 * kWide + 80], 0);
}

TEST(Renderer, WhatMovesWhileTheImageGathersLightIsBlurred) {
  TerrainConfig config = flatSeafloor();
  config.detail_contrast = 0.22;
  const SeaTerrain terrain(config);
  const Renderer renderer(terrain, bareOptics(), smallRig(), cameraInBody());
  PhotoConditions still, moving;
  moving.T_begin_end = SE3::fromEuler(0, 0, 0, {0.03, 0, 0});  // 3 pixels at 2 m, along the image's columns
  const auto sharp = lit(renderer, still), smeared = lit(renderer, moving);
  double along[2] = {}, across[2] = {};
  for (int y = 20; y < 100; ++y)
    for (int x = 20; x < 140; ++x)
      for (int k = 0; k < 2; ++k) {
        const auto& image = k == 0 ? sharp : smeared;
        const auto at = static_cast<std::size_t>(y * kWide + x);
        along[k] += std::pow(static_cast<double>(image[at + kWide] - image[at]), 2);
        across[k] += std::pow(static_cast<double>(image[at + 1] - image[at]), 2);
      }
  EXPECT_LT(along[1] / along[0], 0.5 * across[1] / across[0]);
}

TEST(Daylight, FallsWithDepthAndCausticsKeepItsMean) {
  DaylightConfig config{.irradiance = 2};
  WaterConfig water;
  const Eigen::Vector3f up(0, 0, -1);
  const Daylight even(config, water, 1, 0);
  const double sun = std::sqrt(1 - std::pow(std::cos(config.sun_elevation_rad) / 1.34, 2));
  for (std::size_t c = 0; c < 3; ++c) {
    const double fall = (water.absorption_per_m[c] + 0.02 * water.scattering_per_m[c]) / sun;
    EXPECT_NEAR(static_cast<double>(even.irradiance(10, {0, 0, 10}, up, true)[c]), 2 * std::exp(-10 * fall),
                1e-4);
    EXPECT_NEAR(static_cast<double>(even.irradiance(10, {0, 0, 10}, up, false)[c]),
                2 * (1 - config.sun_share) * std::exp(-10 * fall), 1e-4);
  }
  config.caustics = 0.5;
  config.sun_share = 1;
  double sum = 0, squares = 0;
  int n = 0;
  for (int t = 0; t < 10; ++t) {
    const Daylight wavy(config, water, 1, 1.7 * t);
    for (int i = 0; i < 200; ++i)
      for (int j = 0; j < 200; ++j, ++n) {
        const Eigen::Vector3f place(0.037F * static_cast<float>(i), 0.041F * static_cast<float>(j), 10);
        const double part = static_cast<double>(wavy.irradiance(10, place, up, true)[1] /
                                                even.irradiance(10, place, up, true)[1]);
        sum += part, squares += part * part;
      }
  }
  const double average = sum / n;
  EXPECT_NEAR(average, 1, 0.02);
  EXPECT_NEAR(std::sqrt(squares / n - average * average), 0.5, 0.02);
}

TEST(Renderer, DaylightAddsToTheStrobesAndIsThereWithoutThem) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = monoOptics();
  optics.water.backscatter_fraction = 0;
  optics.daylight.irradiance = 3;
  const Renderer day(terrain, optics, smallRig(), cameraInBody());
  optics.daylight.irradiance = 0;
  const Renderer night(terrain, optics, smallRig(), cameraInBody());
  PhotoConditions dark;
  dark.flashes = {0, 0};
  EXPECT_EQ(mean(lit(night, dark)), 0);
  EXPECT_NEAR(mean(lit(day, {})) / (mean(lit(night, {})) + mean(lit(day, dark))), 1, 1e-4);
}

TEST(Renderer, AStrobeThatStaysDarkLeavesTheOthersLight) {
  const SeaTerrain terrain(flatSeafloor());
  const Renderer renderer(terrain, monoOptics(), smallRig(), cameraInBody());
  PhotoConditions fore, aft, half;
  fore.flashes = {1, 0}, aft.flashes = {0, 1}, half.flashes = {0.5, 0.5};
  const auto both = lit(renderer, {}), a = lit(renderer, fore), b = lit(renderer, aft),
             c = lit(renderer, half);
  for (std::size_t k = 0; k < both.size(); k += 97) {
    EXPECT_NEAR(static_cast<double>((a[k] + b[k]) / both[k]), 1, 1e-3);
    EXPECT_NEAR(static_cast<double>(c[k] / both[k]), 0.5, 1e-3);
  }
}

TEST(Renderer, TurbidWaterIsThatOfMoreScattering) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = monoOptics();
  PhotoConditions turbid;
  turbid.turbidity = 2.5;
  const auto by_moment = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), turbid);
  const auto clear = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), {});
  for (double& b : optics.water.scattering_per_m) b *= 2.5;
  const auto other = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), {});
  // The exposure is set in the configured water, so the second is brighter by one factor everywhere.
  const double factor = mean(other) / mean(by_moment);
  for (std::size_t k = 0; k < other.size(); k += 97)
    EXPECT_NEAR(static_cast<double>(other[k] / by_moment[k]) / factor, 1, 1e-3);
  EXPECT_LT(mean(by_moment), 0.9 * mean(clear));
}

TEST(Renderer, AutomaticExposureKeepsTheLevel) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = monoOptics();
  optics.water.backscatter_fraction = 0;
  const Renderer renderer(terrain, optics, smallRig(), cameraInBody());
  PhotoConditions far;
  far.exposure = renderer.exposureFactor(4);
  const auto centre = [](const std::vector<float>& image) {
    return static_cast<double>(image[60 * kWide + 77]);
  };
  EXPECT_GT(far.exposure, 4);
  EXPECT_NEAR(centre(lit(renderer, far, 4)) / centre(lit(renderer, {}, 2)), 1, 0.02);
}

TEST(Renderer, GlareIsBrightestTowardsTheLamp) {
  const SeaTerrain terrain(flatSeafloor());
  OpticsConfig optics = monoOptics();
  optics.strobes.resize(1);
  optics.strobes[0].position_body = {0, 0.8, 0};  // to starboard, which is right in the image
  const auto before = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), {});
  optics.sensor.glare = 0.01;
  const auto after = lit(Renderer(terrain, optics, smallRig(), cameraInBody()), {});
  const auto added = [&](int x) {
    const auto at = static_cast<std::size_t>(60 * kWide + x);
    return static_cast<double>(after[at] - before[at]);
  };
  EXPECT_GT(added(10), 0);
  EXPECT_GT(added(150), 1.2 * added(10));
}

TEST(AlbedoImages, KeepTheContrastOfTheirPhotographsAndDoNotRepeat) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "ground");
  cv::Mat image(1024, 1360, CV_8UC3);
  cv::theRNG().state = 5;
  cv::randn(image, cv::Scalar(110, 120, 130), cv::Scalar(20, 20, 20));
  for (int y = 0; y < image.rows; ++y)  // lit from one side
    for (int x = 0; x < image.cols; ++x)
      for (int c = 0; c < 3; ++c)
        image.at<cv::Vec3b>(y, x)[c] =
            cv::saturate_cast<std::uint8_t>(image.at<cv::Vec3b>(y, x)[c] * (0.7 + 0.5 * x / image.cols));
  cv::imwrite((folder.path() / "ground" / "a.png").string(), image);
  const AlbedoImages ground(folder.path() / "ground", 0.0014, 1, 3),
      weak(folder.path() / "ground", 0.0014, 0.25, 3);
  const Eigen::Vector3f level = -Eigen::Vector3f::UnitZ(), wall = Eigen::Vector3f::UnitY(),
                        between = Eigen::Vector3f(0.1F, 0.7F, -0.7F).normalized();
  // Over places a step apart along two directions.
  const auto sigmaOver = [&](const AlbedoImages& albedo, double from, const Eigen::Vector3f& normal) {
    const Eigen::Vector3f across = normal.cross(Eigen::Vector3f::UnitX()).normalized();
    double sum = 0, squares = 0;
    int n = 0;
    for (int i = 0; i < 100; ++i)
      for (int j = 0; j < 100; ++j, ++n) {
        const Eigen::Vector3f place = Eigen::Vector3f(static_cast<float>(from + 0.0213 * i), 0, 0) +
                                      0.0197F * static_cast<float>(j) * across;
        const auto v = static_cast<double>(albedo.at(place, normal, 0.0014F)[1]);
        sum += v, squares += v * v;
      }
    return std::sqrt(squares / n - sum * sum / n / n);
  };
  // Of one photograph's own green, its light taken out: 20 grey levels of 120.
  const double usual = sigmaOver(ground, 0, level);
  EXPECT_NEAR(usual / sigmaOver(ground, 40, level), 1, 0.03) << "the same all over";
  EXPECT_NEAR(sigmaOver(weak, 0, level) / usual, 0.25, 0.02);
  EXPECT_NEAR(sigmaOver(ground, 0, wall) / usual, 1, 0.03) << "on a wall, too";
  EXPECT_NEAR(sigmaOver(ground, 0, between) / usual, 1, 0.1);
  double same = 0, scatter = 0;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3f p(0.0113F * static_cast<float>(i % 50), 0.0131F * static_cast<float>(i / 50), 0);
    const double a = static_cast<double>(ground.at(p, level, 0.0014F)[1]),
                 b = static_cast<double>(ground.at(p + Eigen::Vector3f::UnitX(), level, 0.0014F)[1]),
                 m = 0.19;
    same += (a - m) * (b - m), scatter += (a - m) * (a - m);
  }
  EXPECT_LT(std::abs(same / scatter), 0.1);
}

TEST(AlbedoImages, AFolderWithoutPhotographsIsRefused) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(AlbedoImages(folder.path(), 0.0014, 1, 1), std::exception);
  cv::imwrite((folder.path() / "small.png").string(), cv::Mat(64, 64, CV_8UC3, cv::Scalar(9, 9, 9)));
  EXPECT_THROW(AlbedoImages(folder.path(), 0.0014, 1, 1), std::exception);
}

}  // namespace
}  // namespace fathom::sim

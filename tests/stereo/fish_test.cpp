#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig, test::Sheet, test::SyntheticScene;

constexpr int kFishWidth = 800, kFishHeight = 600;  // [px]
constexpr double kFloor = 2.0;                      // [m]

// Results with fish dropped and with fish kept.
struct Results {
  StereoResult dropped, kept;
};

Results resultsOf(const std::vector<Sheet>& sheets) {
  const SyntheticScene scene(croppedRig(kFishWidth, kFishHeight), sheets);
  const auto [left, right] = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  SparseStereoConfig config;
  config.max_features = 600;  // a corner every 4 cm, as 800 give on a full image at 2.6 m
  const StereoResult dropped = SparseStereo(scene.rig(), config).process(left.view(), right.view(), {});
  config.max_fish_length = 0;
  return {dropped, SparseStereo(scene.rig(), config).process(left.view(), right.view(), {})};
}

std::size_t nearer(const StereoResult& result, double depth) {
  return static_cast<std::size_t>(
      std::count_if(result.points.begin(), result.points.end(),
                    [&](const StereoPoint& p) { return static_cast<double>(p.point.z()) < depth; }));
}

// Ground that is not flat, and a fish that is: a spindle seen from above, its back rounded by a third of
// its width.
Sheet floorSheet() {
  return {[](double x, double y) { return kFloor + 0.1 * x + 0.02 * std::sin(20 * y); }};
}
Sheet fishSheet(double length, double gap) {
  const double half = 0.5 * length, width = 0.35 * length;
  const auto across = [=](double x, double y) {
    const double along = (x + 0.6 * y) / 1.17, side = (y - 0.6 * x) / 1.17;
    return std::hypot(along / half, side / (0.5 * width));
  };
  return {[=](double x, double y) {
            return kFloor - gap - 0.16 * width * (1 - std::min(1.0, across(x, y) * across(x, y)));
          },
          [=](double x, double y) { return across(x, y) < 1; }};
}

struct Fish {
  double length, gap;  // [m]
};

class FishOf : public testing::TestWithParam<Fish> {};

TEST_P(FishOf, AnySizeAboveTheFloorIsDroppedAndCountedAndTheFloorStays) {
  const auto [length, gap] = GetParam();
  const auto [with, kept] = resultsOf({floorSheet(), fishSheet(length, gap)});
  EXPECT_EQ(nearer(with, kFloor - gap + 0.1), 0U);
  const std::size_t on_fish = nearer(kept, kFloor - gap + 0.1);
  EXPECT_GE(with.rejected.fish + with.rejected.outlier, on_fish);
  if (on_fish >= 6) {
    EXPECT_GE(with.rejected.fish, on_fish * 9 / 10);
  }
  EXPECT_GE(static_cast<double>(with.points.size()),
            0.97 * static_cast<double>(kept.points.size() - on_fish));
}

INSTANTIATE_TEST_SUITE_P(Sizes, FishOf,
                         testing::Values(Fish{0.1, 0.3}, Fish{0.1, 0.7}, Fish{0.15, 0.3}, Fish{0.2, 0.5},
                                         Fish{0.25, 0.3}, Fish{0.25, 0.8}, Fish{0.35, 0.4}, Fish{0.4, 0.3}),
                         [](const auto& instance) {
                           return std::to_string(std::lround(100 * instance.param.length)) + "CmLong" +
                                  std::to_string(std::lround(100 * instance.param.gap)) + "CmUp";
                         });

struct Relief {
  const char* name;
  std::vector<Sheet> sheets;
  double above;  // points nearer than this are on the relief [m]
};

class ReliefOf : public testing::TestWithParam<Relief> {};

TEST_P(ReliefOf, RockIsNotTakenForFish) {
  const auto [result, all] = resultsOf(GetParam().sheets);
  EXPECT_EQ(result.rejected.fish, 0U);
  EXPECT_GE(nearer(all, GetParam().above), 15U);
  EXPECT_EQ(nearer(result, GetParam().above), nearer(all, GetParam().above));
}

double dome(double x, double y, double radius, double height) {
  const double r = std::hypot(x, y) / radius;
  return r < 1 ? height * std::sqrt(1 - r * r) : 0.0;
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, ReliefOf,
    testing::Values(
        // Half a ball: its flanks are upright at the foot.
        Relief{"RoundBoulder",
               {{[](double x, double y) { return kFloor - dome(x, y, 0.15, 0.15); }}},
               kFloor - 0.08},
        // A flat top on a stalk that is hidden below it, half as high as wide.
        Relief{"TableCoral",
               {floorSheet(),
                {[](double, double) { return kFloor - 0.2; },
                 [](double x, double y) { return std::hypot(x, y) < 0.2; }}},
               kFloor - 0.15},
        // Upright and tall all round but for one side, where it slopes to the floor.
        Relief{"LeaningBlock",
               {{[](double x, double y) {
                 const bool top = std::abs(x) < 0.1 && std::abs(y) < 0.08;
                 const bool slope = std::abs(x) < 0.1 && y >= 0.08 && y < 0.28;
                 return kFloor - (top ? 0.25 : slope ? 0.25 * (0.28 - y) / 0.2 : 0.0);
               }}},
               kFloor - 0.2},
        Relief{"LedgeAcrossTheImage",
               {floorSheet(),
                {[](double, double) { return kFloor - 0.5; }, [](double x, double) { return x < -0.1; }}},
               kFloor - 0.4},
        Relief{"SpurOfADropOffReachingTheImagesEdge",
               {{[](double, double) { return 3.2; }},
                {[](double, double) { return 1.9; },
                 [](double x, double y) { return std::abs(x) < 0.08 && y < 0.05; }}},
               2.2},
        // The floor seen through a hole is farther than its surroundings, not nearer.
        Relief{
            "HoleInTheGround",
            {{[](double, double) { return 2.4; }},
             {[](double, double) { return 1.8; }, [](double x, double y) { return std::hypot(x, y) > 0.1; }}},
            2.0}),
    [](const auto& instance) { return instance.param.name; });

// Marine snow: specks of matter before the floor, nearer ones larger, brighter and more out of focus. What is
// lit in one camera's sight need not be in the other's.
struct Snow {
  const char* name;
  int specks;     // in the cameras' sight
  double shared;  // of them that both cameras show
};

void addSpeck(test::GrayImage& image, const Eigen::Vector2d& at, double sigma, double bright) {
  const int reach = static_cast<int>(3 * sigma) + 1;
  for (int y = static_cast<int>(at.y()) - reach; y <= static_cast<int>(at.y()) + reach; ++y)
    for (int x = static_cast<int>(at.x()) - reach; x <= static_cast<int>(at.x()) + reach; ++x) {
      if (x < 0 || y < 0 || x >= image.width || y >= image.height) continue;
      std::uint8_t& value = image.pixels[static_cast<std::size_t>(y * image.width + x)];
      const double light =
          bright * std::exp(-0.5 * (Eigen::Vector2d(x, y) - at).squaredNorm() / (sigma * sigma));
      value = static_cast<std::uint8_t>(std::min(255.0, value + light));
    }
}

void addSnow(const StereoRig& rig, const Snow& snow, test::GrayImage& left, test::GrayImage& right) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int k = 0; k < snow.specks; ++k) {
    // Evenly over the volume that a camera sees.
    const double z = (kFloor - 0.1) * std::cbrt(std::max(0.01, unit(random)));
    const Eigen::Vector2d pixel(kFishWidth * unit(random), kFishHeight * unit(random));
    const double sigma = 0.8 + 0.9 / z, bright = (30 + 120 * unit(random)) / (z * z);
    const bool both = unit(random) < snow.shared, in_left = both || unit(random) < 0.5;
    if (in_left) addSpeck(left, pixel, sigma, bright);
    if (!in_left || both) {
      const Eigen::Vector3d p = z * rig.left.ray(pixel);
      addSpeck(right, rig.right.project(rig.T_right_left * p), sigma, bright * (0.6 + 0.8 * unit(random)));
    }
  }
}

class SnowOf : public testing::TestWithParam<Snow> {};

TEST_P(SnowOf, DoesNotBecomePoints) {
  const SyntheticScene scene(croppedRig(kFishWidth, kFishHeight), {floorSheet()});
  auto [left, right] = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  SparseStereo stereo(scene.rig(), {.max_features = 600});
  const std::size_t clear = stereo.process(left.view(), right.view(), {}).points.size();
  addSnow(scene.rig(), GetParam(), left, right);
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  std::size_t off = 0;
  double worst = 0;
  for (const StereoPoint& p : result.points) {
    Eigen::Vector3d truth;
    ASSERT_TRUE(scene.pointAt(p.left.cast<double>(), truth));
    const double error = std::abs(static_cast<double>(p.point.z()) - truth.z());
    worst = std::max(worst, error);
    off += error > 0.05 ? 1 : 0;
  }
  std::printf("%zu points in clear water, %zu in snow, %zu off by more than 5 cm, the worst by %.1f cm\n",
              clear, result.points.size(), off, 100 * worst);
  EXPECT_EQ(off, 0U);
  EXPECT_GE(result.points.size(), clear / 2);
}

INSTANTIATE_TEST_SUITE_P(Kinds, SnowOf,
                         testing::Values(Snow{"Light", 60, 0.5}, Snow{"Heavy", 400, 0.5},
                                         Snow{"HeavySeenByBoth", 400, 1.0}, Snow{"HeavySeenByOne", 400, 0.0}),
                         [](const auto& instance) { return instance.param.name; });

// Where silt hides the floor, specks that look like each other match here and there.
TEST(SparseStereo, SnowBeforeAHiddenFloorIsNoGround) {
  const SyntheticScene scene(croppedRig(kFishWidth, kFishHeight), {floorSheet()});
  SparseStereo stereo(scene.rig(), {.max_features = 600});
  for (const Snow& snow : {Snow{"", 400, 0.0}, Snow{"", 1600, 0.0}, Snow{"", 1600, 0.5}}) {
    auto [left, right] = scene.render({0.0, 60.0, 2.0}, {0.0, 60.0, 3.0});
    addSnow(scene.rig(), snow, left, right);
    EXPECT_EQ(stereo.process(left.view(), right.view(), {}).points.size(), 0U) << snow.specks;
  }
}

}  // namespace
}  // namespace fathom::stereo

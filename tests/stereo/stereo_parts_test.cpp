#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <random>
#include <set>

#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/gray_pyramid.hpp"
#include "recon/stereo/kernels/kernels.hpp"
#include "recon/stereo/seed_plane.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::stereo {
namespace {

using Point = Delaunay::Point;
using Triangle = Delaunay::Triangle;
using test::croppedRig, test::Exposure, test::Sheet, test::SyntheticScene;

std::int64_t area2(const Point& a, const Point& b, const Point& c) {
  return static_cast<std::int64_t>(b[0] - a[0]) * (c[1] - a[1]) -
         static_cast<std::int64_t>(b[1] - a[1]) * (c[0] - a[0]);
}

bool insideCircle(const Point& a, const Point& b, const Point& c, const Point& p) {
  const long double ax = a[0] - p[0], ay = a[1] - p[1], bx = b[0] - p[0], by = b[1] - p[1], cx = c[0] - p[0],
                    cy = c[1] - p[1];
  return (ax * ax + ay * ay) * (bx * cy - cx * by) - (bx * bx + by * by) * (ax * cy - cx * ay) +
             (cx * cx + cy * cy) * (ax * by - bx * ay) >
         0;
}

// No point in a circumcircle, each inner edge in two triangles of opposite direction, area as given.
void expectDelaunay(const std::vector<Point>& points, const std::vector<Triangle>& triangles, double area) {
  std::int64_t sum = 0;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const Triangle& t : triangles) {
    const Point &a = points[t[0]], &b = points[t[1]], &c = points[t[2]];
    ASSERT_GT(area2(a, b, c), 0);
    sum += area2(a, b, c);
    for (const Point& p : points) ASSERT_FALSE(insideCircle(a, b, c, p));
    for (std::size_t i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  for (const auto& [edge, count] : edges) EXPECT_EQ(count, 1);
  EXPECT_NEAR(0.5 * static_cast<double>(sum), area, 0.005 * area);
}

TEST(Delaunay, RandomPointsHaveEmptyCircumcirclesAndCoverTheirHull) {
  std::mt19937 random(4);
  std::vector<Point> points{{0, 0}, {1359, 0}, {0, 1023}, {1359, 1023}};
  for (int i = 0; i < 600; ++i)
    points.push_back(
        {static_cast<std::int32_t>(random() % 1360), static_cast<std::int32_t>(random() % 1024)});
  Delaunay delaunay;
  expectDelaunay(points, delaunay.triangulate(points), 1359.0 * 1023.0);
}

TEST(Delaunay, RegularGridOfCocircularPointsIsCoveredOnce) {
  std::vector<Point> points;
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 25; ++x) points.push_back({x * 7, y * 7});
  Delaunay delaunay;
  const auto& triangles = delaunay.triangulate(points);
  EXPECT_EQ(triangles.size(), 2U * 24U * 19U);
  expectDelaunay(points, triangles, 24 * 7.0 * 19 * 7.0);
}

TEST(Delaunay, DegenerateInputGivesNoTriangle) {
  Delaunay delaunay;
  EXPECT_TRUE(delaunay.triangulate({}).empty());
  EXPECT_TRUE(delaunay.triangulate(std::vector<Point>{{1, 1}}).empty());
  EXPECT_TRUE(delaunay.triangulate(std::vector<Point>{{1, 1}, {5, 9}}).empty());
  EXPECT_TRUE(delaunay.triangulate(std::vector<Point>{{1, 1}, {2, 2}, {3, 3}, {9, 9}}).empty());
  EXPECT_TRUE(delaunay.triangulate(std::vector<Point>(10, Point{4, 4})).empty());
}

TEST(Delaunay, RepeatedPointsAreUsedOnce) {
  Delaunay delaunay;
  const auto& triangles = delaunay.triangulate(std::vector<Point>{{0, 0}, {10, 0}, {0, 0}, {0, 10}, {10, 0}});
  ASSERT_EQ(triangles.size(), 1U);
  const std::set<std::uint32_t> used(triangles[0].begin(), triangles[0].end());
  EXPECT_EQ(used, (std::set<std::uint32_t>{0, 1, 3}));
}

TEST(Delaunay, SecondUseGivesTheSameAsAFreshOne) {
  std::mt19937 random(8);
  std::vector<Point> points;
  for (int i = 0; i < 200; ++i)
    points.push_back({static_cast<std::int32_t>(random() % 300), static_cast<std::int32_t>(random() % 300)});
  Delaunay used, fresh;
  (void)used.triangulate(std::vector<Point>{{0, 0}, {10, 0}, {0, 10}, {100, 100}});
  EXPECT_EQ(used.triangulate(points), fresh.triangulate(points));
}

GrayLevel levelOf(int width, int height, int (*value)(int, int)) {
  GrayLevel level;
  level.resize(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) level.row(y)[x] = static_cast<std::uint8_t>(value(x, y));
  level.extendBorder();
  return level;
}

// 8-pixel squares: corners where four of them meet.
int chessboard(int x, int y) {
  return (x / 8 + y / 8) % 2 == 0 ? 40 : 200;
}

TEST(HarrisCorners, CornersOfAChessboardAreFoundWhereItsSquaresMeet) {
  const GrayLevel level = levelOf(96, 80, chessboard);
  HarrisCorners harris(96, 200, fastestKernels());
  const auto& corners = harris.find(level, {0, 0, 96, 80}, 4, 200);
  EXPECT_EQ(corners.size(), 11U * 9U);
  // Squares meet in the middle between the pixels 7 and 8. Windows centred up to 1.5 px away hold the same
  // gradients, so that the measure is the same there.
  for (const Corner& c : corners) {
    EXPECT_LE(std::abs((c.x + 4) % 8 - 3.5), 1.5) << c.x;
    EXPECT_LE(std::abs((c.y + 4) % 8 - 3.5), 1.5) << c.y;
  }
}

TEST(HarrisCorners, EdgesAndFlatGroundAndRampsAreNoCorners) {
  HarrisCorners harris(96, 200, fastestKernels());
  for (const GrayLevel& level : {levelOf(64, 64, [](int x, int) { return x < 32 ? 20 : 220; }),
                                 levelOf(64, 64, [](int, int) { return 90; }),
                                 levelOf(64, 64, [](int x, int y) { return x + 2 * y; })})
    EXPECT_TRUE(harris.find(level, {0, 0, 64, 64}, 7, 100).empty());
}

TEST(HarrisCorners, BoxMarginAndNumberAreKept) {
  const GrayLevel level = levelOf(96, 80, chessboard);
  HarrisCorners harris(96, 200, fastestKernels());
  for (const Corner& c : harris.find(level, {20, 10, 60, 50}, 4, 200)) {
    EXPECT_TRUE(c.x >= 20 && c.x < 60 && c.y >= 10 && c.y < 50);
  }
  for (const Corner& c : harris.find(level, {0, 0, 96, 80}, 17, 200)) {
    EXPECT_TRUE(c.x >= 17 && c.x < 96 - 17 && c.y >= 17 && c.y < 80 - 17);
  }
  EXPECT_EQ(harris.find(level, {0, 0, 96, 80}, 4, 10).size(), 10U);
  EXPECT_TRUE(harris.find(level, {0, 0, 96, 80}, 48, 10).empty());
  EXPECT_TRUE(harris.find(level, {50, 50, 20, 20}, 4, 10).empty());
}

// Points of a plane seen through 40 by 30 degrees, with noise of `sigma` m and a share of gross errors nearer
// by half.
std::vector<StereoPoint> pointsOf(const SeedPlane& plane, int count, double sigma, double gross) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(-0.36, 0.36), y(-0.27, 0.27), chance(0, 1);
  std::normal_distribution<double> noise(0, sigma);
  std::vector<StereoPoint> points;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d ray(x(random), y(random), 1);
    double z = plane.distance / plane.normal.dot(ray) + noise(random);
    if (chance(random) < gross) z *= 0.5 + 0.1 * chance(random);
    points.emplace_back();
    points.back().point = (ray * z).cast<float>();
  }
  return points;
}

TEST(SeedPlane, IsRecoveredThroughAThirdOfGrossErrors) {
  const SeedPlane truth{Eigen::Vector3d(0.12, -0.2, 1).normalized(), 2.4};
  const auto plane = fitSeedPlane(pointsOf(truth, 300, 0.01, 0.33));
  ASSERT_TRUE(plane.has_value());
  EXPECT_NEAR(plane->distance, truth.distance, 0.02);
  EXPECT_LT((plane->normal - truth.normal).norm(), 0.02);
}

TEST(SeedPlane, IsElsewhereWhereItIsNotAboutTheSeed) {
  std::vector<double> scratch(300);
  for (const double distance : {2.0, 2.9, 3.1, 1.4, 1.3}) {
    const SeedPlane truth{Eigen::Vector3d(0.12, -0.2, 1).normalized(), distance};
    const double ahead = truth.ahead();
    const SeedPlane seed{Eigen::Vector3d::UnitZ(), 2.0 * ahead / distance};
    const auto ground = groundElsewhere(pointsOf(truth, 300, 0.01, 0.2), seed, scratch);
    EXPECT_EQ(ground.has_value(), distance > 3 || distance < 1.35) << distance;
    if (ground) {
      EXPECT_NEAR(ground->distance, truth.distance, 0.02);
    }
  }
  EXPECT_FALSE(groundElsewhere({}, {}, {}).has_value());
}

TEST(SeedPlane, IsAbsentForTooFewPoints) {
  const SeedPlane truth{Eigen::Vector3d::UnitZ(), 2};
  EXPECT_FALSE(fitSeedPlane(pointsOf(truth, 11, 0.01, 0)).has_value());
  std::vector<StereoPoint> one_ray(50);
  for (StereoPoint& p : one_ray) p.point = {0.1F, 0.1F, 2.0F};
  EXPECT_FALSE(fitSeedPlane(one_ray).has_value());
}

TEST(SeedPlane, AWideSearchReachesBothEndsOfTheRangesOrTheFarOne) {
  StereoRig rig;
  rig.left = {1360, 1024, 1700, 1700, 680, 512};
  rig.right = rig.left;
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-0.07, 0, 0});
  const auto disparity = [](double z) { return 1700 * 0.07 / z; };
  const WideSearch both = wideSearch(rig, 0.5, 12);
  EXPECT_NEAR(disparity(both.plane.distance) + both.search_radius, disparity(0.5), 1e-6);
  EXPECT_NEAR(disparity(both.plane.distance) - both.search_radius, disparity(12), 1e-6);
  const WideSearch far = wideSearch(rig, 0.1, 12);
  EXPECT_EQ(far.search_radius, 256);
  EXPECT_NEAR(disparity(far.plane.distance) - far.search_radius, disparity(12), 1e-6);
}

StereoResult resultOf(const Kernels& kernels, const SparseStereoConfig& config) {
  // Odd sizes: rows end inside a vector.
  const Sheet floor{[](double x, double y) { return 2.0 + 0.4 * x + 0.1 * y; }};
  static const SyntheticScene scene(croppedRig(333, 251), {floor});
  static const auto images = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  return SparseStereo(scene.rig(), config, &kernels).process(images.first.view(), images.second.view(), {});
}

class KernelsWithWindow : public testing::TestWithParam<int> {};

TEST_P(KernelsWithWindow, EveryInstructionSetGivesTheSameBytes) {
  if (&fastestKernels() == &baselineKernels())
    GTEST_SKIP() << "this processor has no faster instruction set than the baseline";
  SparseStereoConfig config;
  config.window = GetParam();
  config.max_features = 900;
  const StereoResult a = resultOf(baselineKernels(), config), b = resultOf(fastestKernels(), config);
  ASSERT_GE(a.points.size(), 300U);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    ASSERT_EQ(a.points[i].left, b.points[i].left);
    ASSERT_EQ(a.points[i].right, b.points[i].right);
    ASSERT_EQ(a.points[i].point, b.points[i].point);
    ASSERT_EQ(a.points[i].sigma_z, b.points[i].sigma_z);
  }
  EXPECT_EQ(a.triangles, b.triangles);
}

INSTANTIATE_TEST_SUITE_P(Windows, KernelsWithWindow, testing::Values(7, 9, 15, 17, 31));

}  // namespace
}  // namespace fathom::stereo

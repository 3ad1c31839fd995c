#include "recon/stereo/delaunay.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

namespace fathom::stereo {
namespace {

using Point = Delaunay::Point;
using Triangle = Delaunay::Triangle;

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

}  // namespace
}  // namespace fathom::stereo

// The map's mesh at every level: no cracks, no bias.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

#include "recon/fusion/quadtree_map.hpp"
#include "tests/fusion/synthetic_footprint.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;

QuadtreeConfig meshConfig() {
  QuadtreeConfig c;
  c.root_size = 16;
  c.max_level = 6;  // cells of 1/64 m
  c.max_tiles = 4096;
  return c;
}

double ground(double n, double e) {
  return 8.0 + 0.4 * n - 0.3 * e + 0.1 * std::sin(4 * n) * std::cos(3 * e);
}

// Coarse ground with finer patches of several levels in it, a hole, and ragged borders.
void fuseMixed(QuadtreeMap& map) {
  (void)map.fuse(rangeMesh({.length = 7, .width = 6, .spacing = 0.75, .sigma = 0.02}, ground, 1));
  (void)map.fuse(rangeMesh({.north = 5, .length = 4, .width = 3, .spacing = 0.3, .sigma = 0.02}, ground, 2));
  (void)map.fuse(rangeMesh({.north = 1, .east = 1, .length = 1.7, .width = 1.3, .spacing = 0.08}, ground, 3));
  (void)map.fuse(
      rangeMesh({.north = 1.2, .east = 1.5, .length = 0.9, .width = 0.8, .spacing = 0.022}, ground, 4));
  (void)map.fuse(
      rangeMesh({.north = -3.4, .east = -2.9, .length = 1, .width = 1, .spacing = 0.03}, ground, 5));
  // Scattered triangles: cells with three nodes, holes of one cell and more.
  Mesh ragged = rangeMesh({.north = -1, .east = 4.2, .length = 3, .width = 2, .spacing = 0.07}, ground, 6);
  std::mt19937 random(7);
  std::shuffle(ragged.triangles.begin(), ragged.triangles.end(), random);
  ragged.triangles.resize(ragged.triangles.size() / 2);
  (void)map.fuse(ragged);
}

using Edge = std::pair<std::uint32_t, std::uint32_t>;

// Every edge belongs to one or two triangles, never twice in the same direction; no vertex is on the inside
// of an edge; no two vertices are at one place; no triangle is reversed or flat in plan.
void expectNoCracks(const Mesh& mesh) {
  std::map<Edge, int> directed;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++directed[{t[k], t[(k + 1) % 3]}];
    const Eigen::Vector3f u = mesh.vertices[t[1]] - mesh.vertices[t[0]],
                          v = mesh.vertices[t[2]] - mesh.vertices[t[0]];
    ASSERT_LT(u.x() * v.y() - u.y() * v.x(), 0.0F);
  }
  std::set<std::pair<float, float>> places;
  for (const auto& v : mesh.vertices) ASSERT_TRUE(places.insert({v.x(), v.y()}).second);
  std::size_t borders = 0;
  for (const auto& [edge, times] : directed) {
    ASSERT_EQ(times, 1);
    if (directed.count({edge.second, edge.first}) > 0) continue;
    ++borders;
  }
  EXPECT_GT(borders, 0u);
  // By place: a vertex inside an edge would be one of a finer lattice on the same line. Edges along the axes
  // are tested by lines, others against all vertices near them.
  std::map<float, std::vector<float>> by_x, by_y;
  for (const auto& v : mesh.vertices) {
    by_x[v.x()].push_back(v.y());
    by_y[v.y()].push_back(v.x());
  }
  for (auto* lines : {&by_x, &by_y})
    for (auto& [at, line] : *lines) std::sort(line.begin(), line.end());
  const auto between = [](const std::vector<float>& line, float a, float b) {
    const auto first = std::upper_bound(line.begin(), line.end(), std::min(a, b));
    return first != line.end() && *first < std::max(a, b);
  };
  for (const auto& [edge, times] : directed) {
    const auto &a = mesh.vertices[edge.first], &b = mesh.vertices[edge.second];
    if (a.x() == b.x()) {
      ASSERT_FALSE(between(by_x[a.x()], a.y(), b.y())) << a.transpose() << " to " << b.transpose();
      continue;
    }
    if (a.y() == b.y()) {
      ASSERT_FALSE(between(by_y[a.y()], a.x(), b.x())) << a.transpose() << " to " << b.transpose();
      continue;
    }
    const Eigen::Vector2f along = b.head<2>() - a.head<2>();
    for (auto it = by_x.upper_bound(std::min(a.x(), b.x()));
         it != by_x.end() && it->first < std::max(a.x(), b.x()); ++it) {
      const float y = a.y() + along.y() * (it->first - a.x()) / along.x();
      ASSERT_FALSE(std::binary_search(it->second.begin(), it->second.end(), y));
    }
  }
}

TEST(QuadtreeMesh, HasNoCracksWhereLevelsMeet) {
  QuadtreeMap map(meshConfig());
  fuseMixed(map);
  std::set<int> levels;
  map.forEachLeaf([&](const TileKey& key, std::uint32_t) { levels.insert(key.level); });
  ASSERT_GE(levels.size(), 4u);
  const Mesh mesh = toMesh(map);
  ASSERT_GT(mesh.triangles.size(), 5000u);
  expectNoCracks(mesh);
}

TEST(QuadtreeMesh, HasNoCracksAtAnyLevel) {
  QuadtreeMap map(meshConfig());
  fuseMixed(map);
  std::size_t last = 0;
  for (int level = 0; level <= meshConfig().max_level; ++level) {
    const Mesh mesh = meshAt(map, level);
    expectNoCracks(mesh);
    EXPECT_GE(mesh.triangles.size(), last);
    last = mesh.triangles.size();
  }
  EXPECT_EQ(last, toMesh(map).triangles.size());
}

TEST(QuadtreeMesh, HasNoCracksAfterCoarsening) {
  QuadtreeMap map(meshConfig());
  fuseMixed(map);
  int coarsened = 0;
  for (int level = 5; level >= 3; --level)
    for (int n = -8; n < 8; ++n)
      for (int e = -8; e < 0; ++e) coarsened += map.coarsen({n, e, static_cast<std::int16_t>(level)}) ? 1 : 0;
  EXPECT_GT(coarsened, 2);
  expectNoCracks(toMesh(map));
}

TEST(QuadtreeMesh, APlaneStaysAPlaneAtEveryLevelUpToItsBorder) {
  const auto plane = [](double n, double e) { return 10 + 0.6 * n - 0.35 * e; };
  QuadtreeMap map(meshConfig());
  (void)map.fuse(rangeMesh({.length = 5.3, .width = 4.1, .spacing = 0.5, .sigma = 0}, plane, 1));
  (void)map.fuse(rangeMesh(
      {.north = 0.4, .east = 0.3, .length = 1.37, .width = 1.81, .spacing = 0.05, .sigma = 0}, plane, 2));
  for (int level = 2; level <= meshConfig().max_level; ++level) {
    double worst = 0;
    for (const auto& v : meshAt(map, level).vertices)
      worst = std::max(worst, std::abs(static_cast<double>(v.z()) - plane(v.x(), v.y())));
    EXPECT_LT(worst, 0.002) << "level " << level;
  }
}

TEST(QuadtreeMesh, TilesOfEveryLevelJoinAtTheirEdges) {
  QuadtreeMap map(meshConfig());
  fuseMixed(map);
  HeightTile south, north;
  int compared = 0;
  for (std::int16_t level = 1; level <= 6; ++level)
    for (int n = -(2 << level); n < (2 << level); ++n)
      for (int e = -(1 << level) / 2; e <= (1 << level) / 2; ++e) {
        if (!map.extract({n, e, level}, south) || !map.extract({n + 1, e, level}, north)) continue;
        ++compared;
        for (int j = 0; j < HeightTile::kSide; ++j) {
          ASSERT_EQ(south.at(HeightTile::kCells, j).depth, north.at(0, j).depth);
          ASSERT_EQ(south.at(HeightTile::kCells, j).coverage, north.at(0, j).coverage);
        }
      }
  EXPECT_GT(compared, 50);
}

}  // namespace
}  // namespace fathom::fusion

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

#include "recon/fusion/mesh_observations.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;

// The onboard map subtracts exactly what it added, in any order, coarsened or not.

QuadtreeConfig exactConfig() {
  return {.root_size = 16, .max_level = 5, .max_tiles = 2048};  // cells of 1/32 m
}

// Dense, sparse and rough meshes over one another.
std::vector<Mesh> meshes(int count) {
  std::vector<Mesh> out;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-2, 2);
  for (int k = 0; k < count; ++k)
    out.push_back(rangeMesh({.north = place(random),
                             .east = place(random),
                             .length = 1.5,
                             .width = 1.2,
                             .spacing = k % 5 == 0   ? 0.3
                                        : k % 3 == 0 ? 0.045
                                                     : 0.08,
                             .sigma = k % 4 == 0 ? 0.05 : 0.01,
                             .colour = {static_cast<std::uint8_t>(3 * k), 120, 200}},
                            test::reef, static_cast<unsigned>(k)));
  return out;
}

// Level by level, every square that can be.
void coarsenAll(QuadtreeMap& map, int to_level) {
  for (int level = exactConfig().max_level - 1; level >= to_level; --level)
    for (int n = -(1 << level); n < (1 << level); ++n)
      for (int e = -(1 << level); e < (1 << level); ++e)
        (void)map.coarsen({n, e, static_cast<std::int16_t>(level)});
}

TEST(LayerSums, AddAndSubtractToZeroAtTheirLargest) {
  LayerSums sums;
  const LayerSums most = LayerSums::of(kMaxWeight, (1U << 15) - 1, {255, 255, 255});
  const LayerSums least = LayerSums::of(1, 0, {0, 0, 1});
  LayerSums block = most;  // 2^22 of them
  for (int k = 0; k < 22; ++k) block += LayerSums(block);
  sums += block;
  sums += least;
  EXPECT_EQ(sums.count(), (1U << 22) + 1);
  EXPECT_EQ(sums.weight(), (std::uint64_t{kMaxWeight} << 22) + 1);
  EXPECT_EQ(sums.height(), std::uint64_t{kMaxWeight} * ((1U << 15) - 1) << 22);
  EXPECT_EQ(sums.colour(0), (std::uint64_t{kMaxWeight} * 255) << 22);
  EXPECT_EQ(sums.colour(2), ((std::uint64_t{kMaxWeight} * 255) << 22) + 1);
  sums -= block;
  EXPECT_EQ(sums, least);
  sums -= least;
  EXPECT_EQ(sums, LayerSums());
}

TEST(LayerSums, RebasedAreTheSumsOfTheSameHeightsFromALowerEdge) {
  LayerSums near = LayerSums::of(7, 100, {1, 2, 3});
  near += LayerSums::of(900, 1000, {9, 8, 7});
  LayerSums far = LayerSums::of(7, 1124, {1, 2, 3});
  far += LayerSums::of(900, 2024, {9, 8, 7});
  near.rebase(1024);
  EXPECT_EQ(near, far);
}

TEST(QuadtreeExactness, TheMapDoesNotDependOnTheOrderOfMeshes) {
  std::vector<Mesh> all = meshes(40);
  QuadtreeMap forwards(exactConfig()), backwards(exactConfig());
  for (const Mesh& mesh : all) (void)forwards.fuse(mesh);
  std::reverse(all.begin(), all.end());
  for (const Mesh& mesh : all) (void)backwards.fuse(mesh);
  ASSERT_FALSE(forwards.canonicalBytes().empty());
  EXPECT_TRUE(forwards.canonicalBytes() == backwards.canonicalBytes());
}

TEST(QuadtreeExactness, MeshesTakenOutInAnyOrderLeaveTheMapThatNeverHadThem) {
  const std::vector<Mesh> all = meshes(40);
  QuadtreeMap map(exactConfig()), without(exactConfig());
  for (const Mesh& mesh : all) (void)map.fuse(mesh);
  std::vector<std::size_t> order(all.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::shuffle(order.begin(), order.end(), std::mt19937(3));
  for (std::size_t k = 0; k < 25; ++k) (void)map.remove(all[order[k]]);
  for (std::size_t k = 25; k < order.size(); ++k) (void)without.fuse(all[order[k]]);
  EXPECT_TRUE(map.canonicalBytes() == without.canonicalBytes());
  for (std::size_t k = 25; k < order.size(); ++k) (void)map.remove(all[order[k]]);
  EXPECT_TRUE(map.canonicalBytes().empty());
  EXPECT_EQ(map.counters().tiles_used, 0);
  EXPECT_EQ(map.counters().layers_used, 0);
  EXPECT_EQ(map.counters().missing, 0u);
}

TEST(QuadtreeExactness, AMeshThatWentInFineComesOutOfACoarsenedAreaExactly) {
  const std::vector<Mesh> all = meshes(40);
  for (const int level : {3, 1}) {
    QuadtreeMap map(exactConfig()), same(exactConfig());
    for (std::size_t k = 0; k < 30; ++k) (void)map.fuse(all[k]);
    for (std::size_t k = 30; k-- > 0;) (void)same.fuse(all[k]);
    for (QuadtreeMap* m : {&map, &same}) coarsenAll(*m, level);
    ASSERT_GT(map.counters().coarsened, 3u);
    for (std::size_t k = 30; k < 40; ++k) (void)map.fuse(all[k]);  // into the coarsened squares
    for (std::size_t k = 40; k-- > 30;) (void)same.fuse(all[k]);
    for (std::size_t k = 0; k < 20; ++k) (void)map.remove(all[k]);
    for (std::size_t k = 20; k-- > 0;) (void)same.remove(all[k]);
    EXPECT_TRUE(map.canonicalBytes() == same.canonicalBytes());
    // Subtracting the rest leaves nothing.
    for (std::size_t k = 20; k < 40; ++k) (void)map.remove(all[k]);
    EXPECT_TRUE(map.canonicalBytes().empty());
    EXPECT_EQ(map.counters().missing, 0u);
    EXPECT_EQ(map.counters().layers_used, 0);
  }
}

TEST(QuadtreeExactness, CoarseningBeforeAndAfterIsTheSame) {
  const std::vector<Mesh> all = meshes(30);
  QuadtreeMap before(exactConfig()), after(exactConfig());
  for (std::size_t k = 0; k < 15; ++k) (void)before.fuse(all[k]);
  coarsenAll(before, 2);
  for (std::size_t k = 15; k < 30; ++k) (void)before.fuse(all[k]);
  coarsenAll(before, 2);
  for (const Mesh& mesh : all) (void)after.fuse(mesh);
  coarsenAll(after, 2);
  EXPECT_TRUE(before.canonicalBytes() == after.canonicalBytes());
}

TEST(QuadtreeExactness, AMeshThatIsRefusedLeavesNoTrace) {
  QuadtreeConfig small = exactConfig();
  small.max_tiles = 4;
  small.layers_per_tile = 64;
  QuadtreeMap map(small);
  std::vector<Mesh> in;
  for (unsigned k = 0; k < 10; ++k) {
    const Mesh far =
        rangeMesh({.north = 16.0 * k, .east = 40, .length = 9, .width = 9, .spacing = 2}, test::reef, k);
    if (map.fuse(far) > 0) in.push_back(far);
  }
  ASSERT_GT(in.size(), 0u);
  EXPECT_EQ(map.counters().refused, 10 - in.size());
  ASSERT_GT(map.counters().refused, 0u);
  for (const Mesh& mesh : in) (void)map.remove(mesh);
  EXPECT_TRUE(map.canonicalBytes().empty());
  EXPECT_EQ(map.counters().missing, 0u);
}

TEST(QuadtreeExactness, WithAFullPoolMeshesStillComeOutWithoutALooseEnd) {
  QuadtreeConfig small = exactConfig();
  small.max_tiles = 40;
  small.layers_per_tile = 100;
  QuadtreeMap map(small);
  const std::vector<Mesh> all = meshes(60);
  for (const Mesh& mesh : all) (void)map.fuse(mesh);
  EXPECT_GT(map.counters().coarsened, 0u);
  EXPECT_EQ(map.counters().refused, 0u);
  for (const Mesh& mesh : all) (void)map.remove(mesh);
  EXPECT_EQ(map.counters().missing, 0u);
  EXPECT_TRUE(map.canonicalBytes().empty());
}

TEST(QuadtreeExactness, ASurfaceOverAnotherIsMarkedAndNeitherIsAveraged) {
  QuadtreeMap map(exactConfig());
  const auto floor = test::level(6.0);
  const auto ledge = test::level(5.2);
  for (unsigned k = 0; k < 3; ++k) (void)map.fuse(rangeMesh({.sigma = 0.01}, floor, k));
  for (unsigned k = 0; k < 3; ++k)
    (void)map.fuse(rangeMesh({.length = 0.6, .width = 0.6, .sigma = 0.01}, ledge, 10 + k));
  HeightTile tile;
  ASSERT_TRUE(map.extract({0, 0, 5}, tile));  // 0.5 m; the ledge ends at 0.3 m
  EXPECT_TRUE(tile.at(2, 2).layered);
  EXPECT_NEAR(tile.at(2, 2).depth, 5.2, 0.03);  // of equals the upper
  EXPECT_FALSE(tile.at(14, 14).layered);
  EXPECT_NEAR(tile.at(14, 14).depth, 6.0, 0.03);
  (void)map.fuse(rangeMesh({.sigma = 0.01}, floor, 20));
  ASSERT_TRUE(map.extract({0, 0, 5}, tile));
  EXPECT_TRUE(tile.at(2, 2).layered);
  EXPECT_NEAR(tile.at(2, 2).depth, 6.0, 0.03);  // better supported
}

TEST(QuadtreeExactness, AFishSeenOnceDisappearsWithoutMarkWhenOutvoted) {
  QuadtreeMap map(exactConfig()), clean(exactConfig());
  const auto floor = [](double n, double) { return 6.0 + 0.1 * n; };
  const auto fish = test::level(5.5);
  (void)map.fuse(rangeMesh({.length = 0.4, .width = 0.4, .sigma = 0.01}, fish, 1));
  for (unsigned k = 0; k < 4; ++k) {
    (void)map.fuse(rangeMesh({.sigma = 0.01}, floor, 10 + k));
    (void)clean.fuse(rangeMesh({.sigma = 0.01}, floor, 10 + k));
  }
  HeightTile with, without;
  ASSERT_TRUE(map.extract({0, 0, 5}, with));
  ASSERT_TRUE(clean.extract({0, 0, 5}, without));
  for (std::size_t k = 0; k < with.nodes.size(); ++k) {
    EXPECT_EQ(with.nodes[k].depth, without.nodes[k].depth);
    EXPECT_FALSE(with.nodes[k].layered);
  }
}

TEST(QuadtreeExactness, AFishSeenFromNearOnceIsOutvotedByAFloorSeenFromAfarOften) {
  QuadtreeMap map(exactConfig());
  const auto floor = [](double n, double) { return 6.0 + 0.1 * n; };
  const auto fish = test::level(4.8);
  (void)map.fuse(rangeMesh({.length = 0.4, .width = 0.4, .spacing = 0.04, .sigma = 0.01}, fish, 1));
  HeightTile tile;
  ASSERT_TRUE(map.extract({0, 0, 5}, tile));
  EXPECT_NEAR(tile.at(2, 2).depth, 4.8, 0.03);
  (void)map.fuse(rangeMesh({.spacing = 0.2, .sigma = 0.01}, floor, 10));
  ASSERT_TRUE(map.extract({0, 0, 5}, tile));
  EXPECT_TRUE(tile.at(2, 2).layered);
  for (unsigned k = 0; k < 3; ++k) (void)map.fuse(rangeMesh({.spacing = 0.2, .sigma = 0.01}, floor, 20 + k));
  ASSERT_TRUE(map.extract({0, 0, 5}, tile));
  EXPECT_NEAR(tile.at(2, 2).depth, 6.0, 0.03);
  for (const auto& v : toMesh(map).vertices) EXPECT_GT(v.z(), 5.8F);
}

// The map's mesh at every level: no cracks, no bias.

QuadtreeConfig meshConfig() {
  return {.root_size = 16, .max_level = 6, .max_tiles = 4096};  // cells of 1/64 m
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

// The onboard map subtracts exactly what it added, in any order, coarsened or not.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/quadtree_sums.hpp"
#include "tests/fusion/synthetic_footprint.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;

QuadtreeConfig exactConfig() {
  QuadtreeConfig c;
  c.root_size = 16;
  c.max_level = 5;  // cells of 1/32 m
  c.max_tiles = 2048;
  return c;
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
  const auto floor = [](double, double) { return 6.0; };
  const auto ledge = [](double, double) { return 5.2; };
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
  const auto fish = [](double, double) { return 5.5; };
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
  const auto fish = [](double, double) { return 4.8; };
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

}  // namespace
}  // namespace fathom::fusion

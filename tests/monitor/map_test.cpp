#include <gtest/gtest.h>

#include <random>
#include <tuple>

#include "telemetry/monitor/map/block_store.hpp"
#include "telemetry/monitor/map/surface.hpp"
#include "tests/monitor/sample_dive.hpp"

namespace fathom::monitor {
namespace {

using Point = std::tuple<float, float, float>;

// Edges that only one triangle has, of a mesh, vertices at one place counted as one.
std::vector<std::pair<Point, Point>> openEdges(const Mesh& mesh) {
  const auto point = [&](std::uint32_t v) {
    return Point{mesh.vertices[v].x(), mesh.vertices[v].y(), mesh.vertices[v].z()};
  };
  std::map<std::pair<Point, Point>, int> uses;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      auto a = point(t[k]), b = point(t[(k + 1) % 3]);
      if (b < a) std::swap(a, b);
      ++uses[{a, b}];
    }
  std::vector<std::pair<Point, Point>> open;
  for (const auto& [edge, count] : uses)
    if (count == 1) open.push_back(edge);
  return open;
}

TEST(BlockStore, KeepsTheNewestContentAndCountsNoRoundingAsAChange) {
  BlockStore store;
  EXPECT_TRUE(store.put(syntheticBlock(kQuarterMetre, 3, -2), {10, 0.05, true, 10}));
  EXPECT_TRUE(store.put(syntheticBlock(kQuarterMetre, 3, -2, 0.08), {20, 0.05, false, 20}));
  EXPECT_EQ(store.counters().changed, 0U);
  EXPECT_TRUE(store.put(syntheticBlock(kQuarterMetre, 3, -2, 0.3), {30, 0.05, false, 30}));
  EXPECT_EQ(store.counters().changed, 1U);
  const StoredBlock* stored = store.find({kQuarterMetre, 3, -2});
  ASSERT_NE(stored, nullptr);
  EXPECT_EQ(stored->received_utc_ns, 30);
  EXPECT_EQ(stored->changed_utc_ns, 30);
  EXPECT_TRUE(stored->has_colour);  // kept from the first
  EXPECT_EQ(stored->block.colour[0], (Rgb{100, 50, 40}));
  EXPECT_EQ(store.size(), 1U);
}

TEST(BlockStore, RefusesWhatNoDiveHasAndCountsIt) {
  BlockStore store;
  auto odd = syntheticBlock(kMetre, 0, 0);
  odd.key.spacing = telemetry::kPowerCodes + 30;
  EXPECT_FALSE(store.put(odd, {0, 0.05, false, 0}));
  EXPECT_FALSE(store.put(syntheticBlock(kCoarsestCode + 1, 0, 0), {0, 0.05, false, 0}));
  EXPECT_FALSE(store.put(syntheticBlock(kMetre, 2'000'000'000, 0), {0, 0.05, false, 0}));
  EXPECT_FALSE(store.put(syntheticBlock(kMetre, 0, -2'000'000'000), {0, 0.05, false, 0}));
  auto deep = syntheticBlock(kMetre, 0, 0);
  deep.depth[7] = std::nanf("");
  EXPECT_FALSE(store.put(deep, {0, 0.05, false, 0}));
  EXPECT_EQ(store.counters().refused, 5U);
  EXPECT_TRUE(store.chunks().empty());
}

TEST(BlockStore, ABlockOfWhichNothingIsSeenAnyMoreGoes) {
  BlockStore store;
  Surface surface(store);
  for (int n = 0; n < 3; ++n) store.put(syntheticBlock(kQuarterMetre, n, 0), {1, 0.05, false, 1});
  store.put(syntheticBlock(kQuarterMetre, 90, 0), {1, 0.05, false, 1});  // alone in its chunk
  const double area = surface.area();
  auto gone = syntheticBlock(kQuarterMetre, 1, 0);
  gone.seen = 0;
  EXPECT_TRUE(store.put(gone, {2, 0.05, false, 2}));
  EXPECT_EQ(store.size(), 3U);
  EXPECT_LT(surface.area(), area);
  EXPECT_EQ(store.generation(), 0U);
  gone.key.north = 90;
  EXPECT_TRUE(store.put(gone, {2, 0.05, false, 2}));
  EXPECT_EQ(store.generation(), 1U);
  EXPECT_TRUE(store.put(gone, {2, 0.05, false, 2}));  // gone already
  EXPECT_EQ(store.counters().withdrawn, 2U);
  for (int n = 0; n < 1000; ++n) {
    gone.key.north = 1;
    store.put(syntheticBlock(kQuarterMetre, 1, 0), {3, 0.05, false, 3});
    store.put(gone, {4, 0.05, false, 4});
  }
  EXPECT_EQ(store.size(), 2U);
}

TEST(BlockStore, WhenFullLosesTheOldestOfTheFinestBlocksAndNeverTheCoarseMap) {
  BlockStore store(10);
  for (int n = 0; n < 5; ++n)
    store.put(syntheticBlock(kMetre, n, 0), {static_cast<telemetry::Version>(n), 0.05, false, n});
  for (int n = 0; n < 20; ++n)
    store.put(syntheticBlock(kQuarterMetre, n, 0),
              {static_cast<telemetry::Version>(100 + n), 0.05, false, 100 + n});
  EXPECT_EQ(store.size(), 10U);
  EXPECT_EQ(store.size(kMetre), 5U);
  EXPECT_EQ(store.counters().evicted, 15U);
  EXPECT_EQ(store.find({kQuarterMetre, 14, 0}), nullptr);
  EXPECT_NE(store.find({kQuarterMetre, 15, 0}), nullptr);
}

TEST(BlockStore, AFrameThatComesLateTakesNoBlockBackAndWakesNoGhost) {
  BlockStore store;
  telemetry::MapBlock gone = syntheticBlock(kQuarterMetre, 1, 0);
  gone.seen = 0;
  store.put(syntheticBlock(kQuarterMetre, 0, 0, 0.3), {20, 0.05, false, 1});
  EXPECT_TRUE(store.put(syntheticBlock(kQuarterMetre, 0, 0), {19, 0.05, false, 2}));
  EXPECT_EQ(store.find({kQuarterMetre, 0, 0})->version, 20U);
  EXPECT_EQ(store.find({kQuarterMetre, 0, 0})->block.depth, syntheticBlock(kQuarterMetre, 0, 0, 0.3).depth);
  store.put(gone, {20, 0.05, false, 3});  // of a place of which nothing was received
  store.put(syntheticBlock(kQuarterMetre, 1, 0), {18, 0.05, false, 4});
  EXPECT_EQ(store.find({kQuarterMetre, 1, 0}), nullptr);
  EXPECT_EQ(store.counters().stale, 2U);
  store.put(syntheticBlock(kQuarterMetre, 1, 0), {21, 0.05, false, 5});
  EXPECT_NE(store.find({kQuarterMetre, 1, 0}), nullptr);
}

TEST(BlockStore, StaysBoundedUnderBlocksFromEverywhereAndCountsItsGenerations) {
  BlockStore store(50);
  std::mt19937 random(3);
  for (int n = 0; n < 5000; ++n)
    store.put(syntheticBlock(kMetre, static_cast<int>(random() % 20000) - 10000,
                             static_cast<int>(random() % 20000)),
              {static_cast<telemetry::Version>(n), 0.05, false, n});
  EXPECT_EQ(store.size(), 50U);
  EXPECT_LE(store.chunks().size(), 50U);
  EXPECT_GT(store.generation(), 0U);
}

TEST(Surface, ShowsEveryNodeAtItsPlaceAndTheFinerWhereBothAre) {
  BlockStore store;
  Surface surface(store);
  for (int n = -2; n < 2; ++n)
    for (int e = -2; e < 2; ++e) store.put(syntheticBlock(kMetre, n, e, 0.5), {1, 0.05, false, 1});
  EXPECT_NEAR(surface.area(), 15.0 * 15, 1e-9);
  store.put(syntheticBlock(kQuarterMetre, 1, 1), {2, 0.05, false, 2});
  EXPECT_NEAR(surface.area(), 15.0 * 15, 1e-9);  // nothing is shown twice
  const auto fine = surface.sample(1.25, 1.5), coarse = surface.sample(-3, 5);
  ASSERT_TRUE(fine && coarse);
  EXPECT_NEAR(fine->depth, syntheticDepth(1.25, 1.5), 1e-5);
  EXPECT_EQ(fine->spacing, kQuarterMetre);
  EXPECT_NEAR(coarse->depth, syntheticDepth(-3, 5) + 0.5, 1e-5);
  EXPECT_FALSE(surface.sample(-9, 0) || surface.sample(1e9, 0) || surface.sample(std::nan(""), 0));
}

TEST(Surface, HasNoCracksBetweenLevelsNorBetweenChunks) {
  BlockStore store;
  Surface surface(store);
  for (int n = -5; n < 5; ++n)  // 39 m square about the corner of four chunks
    for (int e = -5; e < 5; ++e) store.put(syntheticBlock(kMetre, n, e), {1, 0.05, false, 1});
  std::mt19937 random(8);
  for (int round = 0; round < 60; ++round) {
    const auto code = static_cast<telemetry::SpacingCode>(2 + random() % 5);  // 3 cm to 50 cm
    const auto index = [&] {
      return static_cast<int>(
          std::floor((static_cast<double>(random() % 3600) / 100 - 18) / (4 * telemetry::spacingOf(code))));
    };
    store.put(syntheticBlock(code, index(), index(), 0.2 * static_cast<double>(random() % 3)),
              {2, 0.05, false, 2});
  }
  const Mesh mesh = surface.whole();
  EXPECT_NEAR(surface.area(), 39.0 * 39, 1e-6);
  const auto outside = [](float v) { return v == -20.F || v == 19.F; };
  for (const auto& [a, b] : openEdges(mesh)) {
    const bool on_rim = (std::get<0>(a) == std::get<0>(b) && outside(std::get<0>(a))) ||
                        (std::get<1>(a) == std::get<1>(b) && outside(std::get<1>(a)));
    EXPECT_TRUE(on_rim) << std::get<0>(a) << ' ' << std::get<1>(a) << " to " << std::get<0>(b) << ' '
                        << std::get<1>(b);
  }
  double plan = 0;
  for (const auto& t : mesh.triangles) {
    const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const double twice = (b.y() - a.y()) * (c.x() - a.x()) - (c.y() - a.y()) * (b.x() - a.x());
    EXPECT_GE(twice, 0) << "counter-clockwise with east to the right and north up";
    plan += twice / 2;
  }
  EXPECT_NEAR(plan, 39.0 * 39, 1e-2);
}

TEST(Surface, OfAPartlySeenBlockShowsTrianglesOfThreeNodes) {
  BlockStore store;
  Surface surface(store);
  auto block = syntheticBlock(kMetre, 0, 0);
  block.seen = 0b0000'0000'0011'0001;  // nodes (0,0), (1,0), (1,1)
  store.put(block, {1, 0.05, false, 1});
  EXPECT_NEAR(surface.area(), 0.5, 1e-9);
  EXPECT_TRUE(surface.sample(0.75, 0.25));
  EXPECT_NEAR(surface.sample(0.5, 0.5)->depth, (block.depth[0] + block.depth[5]) / 2, 1e-5);
  EXPECT_FALSE(surface.sample(0.25, 0.75));
}

TEST(Surface, ABlockRebuildsOnlyTheChunksThatCanSeeIt) {
  BlockStore store;
  Surface surface(store);
  for (int n = 0; n < 12; ++n)
    for (int e = 0; e < 12; ++e) store.put(syntheticBlock(kMetre, n, e), {1, 0.05, false, 1});
  (void)surface.area();
  const std::uint64_t before = store.version();
  store.put(syntheticBlock(kQuarterMetre, 24, 24), {2, 0.05, false, 2});  // the middle of the middle chunk
  int changed = 0;
  for (const auto& [key, chunk] : store.chunks()) changed += chunk->version > before ? 1 : 0;
  EXPECT_EQ(changed, 1);
  const std::uint64_t next = store.version();
  store.put(syntheticBlock(kQuarterMetre, 16, 24),
            {2, 0.05, false, 2});  // at the middle chunk's southern border
  changed = 0;
  for (const auto& [key, chunk] : store.chunks()) changed += chunk->version > next ? 1 : 0;
  EXPECT_EQ(changed, 2);
}

TEST(Surface, IsTheSameWhateverTheOrderOfArrivalAndOfAsking) {
  std::vector<telemetry::MapBlock> blocks;
  for (int n = -3; n < 5; ++n)
    for (int e = -3; e < 5; ++e) blocks.push_back(syntheticBlock(kMetre, n, e));
  for (int n = 0; n < 9; ++n) blocks.push_back(syntheticBlock(kQuarterMetre, n, 2 * n - 7));
  BlockStore first, second;
  Surface one(first), other(second);
  for (const auto& block : blocks) {
    first.put(block, {1, 0.05, false, 1});
    (void)one.area();
  }
  for (auto block = blocks.rbegin(); block != blocks.rend(); ++block) second.put(*block, {1, 0.05, false, 1});
  const Mesh a = one.whole(), b = other.whole();
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.normals, b.normals);
  EXPECT_EQ(a.triangles, b.triangles);
}

}  // namespace
}  // namespace fathom::monitor

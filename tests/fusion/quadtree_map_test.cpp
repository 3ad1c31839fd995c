#include "recon/fusion/quadtree_map.hpp"

#include <gtest/gtest.h>
#include <malloc.h>

#include <map>
#include <set>
#include <stdexcept>
#include <tuple>

#include "tests/support/heap_counter.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::Footprint, test::rangeMesh;

double slope(double n, double e) {
  return 10.0 + 0.3 * n - 0.2 * e;
}
double ripples(double n, double e) {
  return 8.0 + 0.1 * std::sin(2.0 * n) + 0.15 * std::cos(1.5 * e);
}

QuadtreeConfig reefConfig(int max_tiles = 512) {
  return {.root_size = 16, .max_level = 4, .max_tiles = max_tiles};  // 1 m tiles, nodes 6.25 cm
}

struct Errors {
  double rms = 0, worst = 0;
  int nodes = 0;
};

Errors errorsOf(const Mesh& mesh, const std::function<double(double, double)>& truth) {
  Errors out;
  for (const auto& v : mesh.vertices) {
    const double error = static_cast<double>(v.z()) - truth(v.x(), v.y());
    out.rms += error * error;
    out.worst = std::max(out.worst, std::abs(error));
    ++out.nodes;
  }
  out.rms = std::sqrt(out.rms / std::max(1, out.nodes));
  return out;
}

std::vector<TileKey> leavesOf(const QuadtreeMap& map) {
  std::vector<TileKey> keys;
  map.forEachLeaf([&](const TileKey& key, std::uint32_t) { keys.push_back(key); });
  return keys;
}

std::string bytesOf(const QuadtreeMap& map) {
  std::string bytes;
  HeightTile tile;
  map.forEachLeaf([&](const TileKey& key, std::uint32_t revision) {
    if (!map.extract(key, tile)) return;
    bytes.append(reinterpret_cast<const char*>(&revision), sizeof revision);
    for (const auto& node : tile.nodes) {
      bytes.append(reinterpret_cast<const char*>(&node.depth), 12);
      bytes.append(reinterpret_cast<const char*>(node.colour.data()), 3);
    }
  });
  return bytes;
}

TEST(QuadtreeMap, AnEmptyMapHasNoLeavesAndExtractsNothing) {
  const QuadtreeMap map(reefConfig());
  HeightTile tile;
  EXPECT_TRUE(leavesOf(map).empty());
  EXPECT_FALSE(map.extract({0, 0, 0}, tile));
  EXPECT_TRUE(toMesh(map).empty());
}

TEST(QuadtreeMap, ASlopeIsReproducedExactlyAndWithoutHolesAcrossTiles) {
  QuadtreeMap map(reefConfig());
  EXPECT_GT(map.fuse(rangeMesh({.north = 0, .east = 0, .length = 4, .width = 4, .sigma = 0}, slope, 1)),
            3000u);
  const Mesh mesh = toMesh(map);
  const Errors errors = errorsOf(mesh, slope);
  EXPECT_LT(errors.worst, 1e-4);  // heights are counted in units of 0.12 mm
  // 64 x 64 cells of 6.25 cm over 4 x 4 m: each node once, all cells filled.
  EXPECT_EQ(mesh.vertices.size(), 65u * 65u);
  EXPECT_EQ(mesh.triangles.size(), 2u * 64u * 64u);
  for (const auto& n : mesh.normals) EXPECT_LT(n.z(), -0.9F);
}

TEST(QuadtreeMap, NoiseFallsWithTheNumberOfMeshesAsSigmaStates) {
  std::map<int, double> rms;
  for (const int passes : {1, 16}) {
    QuadtreeMap map(reefConfig());
    for (int k = 0; k < passes; ++k)
      (void)map.fuse(rangeMesh({.sigma = 0.03}, slope, 10u + static_cast<unsigned>(k)));
    const Mesh mesh = toMesh(map);
    rms[passes] = errorsOf(mesh, slope).rms;
    double mean_sigma = 0;
    for (const float s : mesh.sigma)
      mean_sigma += static_cast<double>(s) / static_cast<double>(mesh.sigma.size());
    EXPECT_GT(mean_sigma, 0.7 * rms[passes]);
    EXPECT_LT(mean_sigma, 3.0 * rms[passes]);
  }
  EXPECT_LT(rms[16], 0.35 * rms[1]);
}

TEST(QuadtreeMap, APreciseMeshOutweighsARoughOne) {
  QuadtreeMap map(reefConfig());
  (void)map.fuse(rangeMesh({.sigma = 0.08}, slope, 1));
  (void)map.fuse(rangeMesh({.sigma = 0.005}, slope, 2));
  EXPECT_LT(errorsOf(toMesh(map), slope).rms, 0.01);
}

TEST(QuadtreeMap, AFishOverKnownSeafloorLeavesItAsItWas) {
  QuadtreeMap map(reefConfig());
  for (unsigned k = 0; k < 4; ++k) (void)map.fuse(rangeMesh({.sigma = 0.01}, slope, k));
  const auto with_fish = [](double n, double e) {
    return slope(n, e) - (std::hypot(n - 0.2, e + 0.1) < 0.3 ? 0.8 : 0.0);
  };
  (void)map.fuse(rangeMesh({.sigma = 0.01}, with_fish, 50));
  EXPECT_LT(errorsOf(toMesh(map), slope).worst, 0.05);
  EXPECT_GT(map.counters().outvoted, 40u);
}

TEST(QuadtreeMap, AFishSeenFirstIsOutvotedByTheSeafloor) {
  QuadtreeMap map(reefConfig());
  const auto fish = [](double n, double e) { return slope(n, e) - 0.8; };
  (void)map.fuse(rangeMesh({.length = 0.5, .width = 0.5, .sigma = 0.01}, fish, 1));
  for (unsigned k = 0; k < 4; ++k) (void)map.fuse(rangeMesh({.sigma = 0.01}, slope, 10 + k));
  EXPECT_LT(errorsOf(toMesh(map), slope).worst, 0.06);
}

TEST(QuadtreeMap, OfSurfacesOverOneAnotherTheUpperOneIsKept) {
  Mesh both = rangeMesh({.sigma = 0}, test::level(5.0), 1);
  const Mesh ledge = rangeMesh({.length = 1, .width = 1, .sigma = 0}, test::level(4.0), 1);
  const auto offset = static_cast<std::uint32_t>(both.vertices.size());
  both.vertices.insert(both.vertices.end(), ledge.vertices.begin(), ledge.vertices.end());
  both.sigma.insert(both.sigma.end(), ledge.sigma.begin(), ledge.sigma.end());
  both.colours.insert(both.colours.end(), ledge.colours.begin(), ledge.colours.end());
  // Lower surface last: the order of triangles must not matter.
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (const auto& [a, b, c] : ledge.triangles) triangles.push_back({a + offset, b + offset, c + offset});
  triangles.insert(triangles.end(), both.triangles.begin(), both.triangles.end());
  both.triangles = triangles;
  QuadtreeMap map(reefConfig());
  (void)map.fuse(both);
  for (const auto& v : toMesh(map).vertices) {
    const float from_middle = std::max(std::abs(v.x()), std::abs(v.y()));
    if (from_middle == 0.5F) continue;  // a node on the rim is between cells of both
    EXPECT_NEAR(v.z(), from_middle < 0.5F ? 4.0F : 5.0F, 1e-4F) << v.transpose();
  }
}

TEST(QuadtreeMap, SparsePointsMakeCoarserTilesThanDenseOnes) {
  QuadtreeMap dense(reefConfig()), sparse(reefConfig());
  (void)dense.fuse(rangeMesh({.length = 4, .width = 4, .spacing = 0.06}, ripples, 1));
  (void)sparse.fuse(rangeMesh({.length = 4, .width = 4, .spacing = 0.3}, ripples, 1));
  EXPECT_EQ(dense.counters().tiles_used, 16);  // of 1 m
  EXPECT_EQ(sparse.counters().tiles_used, 4);  // of 4 m
  EXPECT_EQ(leavesOf(dense).back().level, 4);
  EXPECT_LT(leavesOf(sparse).back().level, 4);
}

TEST(QuadtreeMap, DenseDataSplitACoarseTileAndKeepItsSurroundings) {
  QuadtreeMap map(reefConfig());
  (void)map.fuse(rangeMesh({.length = 6, .width = 6, .spacing = 0.4, .sigma = 0.02}, slope, 1));
  const auto before = toMesh(map).vertices.size();
  (void)map.fuse(rangeMesh({.length = 2, .width = 2, .spacing = 0.06, .sigma = 0.01}, slope, 2));
  EXPECT_GT(toMesh(map).vertices.size(), before);
  EXPECT_EQ(leavesOf(map).back().level, 4);
  EXPECT_LT(errorsOf(toMesh(map), slope).worst, 0.12);
  // The plane's far corners, seen only by the sparse mesh, are still there.
  double reach = 0;
  for (const auto& v : toMesh(map).vertices) reach = std::max(reach, static_cast<double>(v.x()));
  EXPECT_GT(reach, 2.4);
}

TEST(QuadtreeMap, LeavesNeverOverlapAndComeInKeyOrder) {
  QuadtreeMap map(reefConfig(64));
  for (unsigned k = 0; k < 30; ++k)
    (void)map.fuse(
        rangeMesh({.north = 0.7 * k, .east = 0.3 * k, .spacing = k % 3 == 0 ? 0.3 : 0.08}, ripples, k));
  const std::vector<TileKey> keys = leavesOf(map);
  ASSERT_GT(keys.size(), 10u);
  std::set<std::pair<int, int>> finest_covered;
  for (std::size_t k = 0; k < keys.size(); ++k) {
    if (k > 0) {
      const auto order = [](const TileKey& a) {
        return std::make_tuple(a.level, a.north_index, a.east_index);
      };
      EXPECT_LT(order(keys[k - 1]), order(keys[k]));
    }
    const int scale = 1 << (4 - keys[k].level);
    for (int i = 0; i < scale; ++i)
      for (int j = 0; j < scale; ++j)
        EXPECT_TRUE(
            finest_covered.insert({keys[k].north_index * scale + i, keys[k].east_index * scale + j}).second);
  }
}

TEST(QuadtreeMap, AFullPoolCoarsensTheLeastRecentlySeenAreaAndCountsIt) {
  QuadtreeMap map(reefConfig(40));
  for (unsigned k = 0; k < 20; ++k) (void)map.fuse(rangeMesh({.north = 2.0 * k, .sigma = 0.01}, slope, k));
  const auto counters = map.counters();
  EXPECT_GT(counters.coarsened, 0u);
  EXPECT_LE(counters.tiles_used, 40);
  EXPECT_EQ(counters.tiles_high_water, 40);
  EXPECT_EQ(counters.refused, 0u);
  // The newest footprint is still at the finest level, the oldest is coarse, and both are right.
  const auto levelAt = [&](double north) {
    int found = -1;
    for (const TileKey& key : leavesOf(map)) {
      const double size = 16.0 / (1 << key.level);
      if (north >= key.north_index * size && north < (key.north_index + 1) * size && key.east_index == 0)
        found = std::max(found, static_cast<int>(key.level));
    }
    return found;
  };
  EXPECT_EQ(levelAt(38.0), 4);
  EXPECT_LT(levelAt(0.5), 4);
  const Mesh mesh = toMesh(map);
  double first = 100, last = -100;
  for (const auto& v : mesh.vertices) {
    first = std::min(first, static_cast<double>(v.x()));
    last = std::max(last, static_cast<double>(v.x()));
  }
  EXPECT_LT(first, 0.0);
  EXPECT_GT(last, 38.5);
  EXPECT_LT(errorsOf(mesh, slope).rms, 0.05);
}

TEST(QuadtreeMap, APoolFullOfRootsRefusesNewGroundAndContinues) {
  QuadtreeMap map(reefConfig(4));
  for (unsigned k = 0; k < 12; ++k) (void)map.fuse(rangeMesh({.north = 16.0 * k + 8, .east = 8}, slope, k));
  EXPECT_GT(map.counters().refused, 0u);
  EXPECT_LE(map.counters().tiles_used, 4);
  EXPECT_FALSE(toMesh(map).empty());
}

TEST(QuadtreeMap, ACoarserTileIsTheMeanOfTheLeavesBelow) {
  QuadtreeMap map(reefConfig());
  (void)map.fuse(rangeMesh({.north = 4, .east = 4, .length = 8, .width = 8, .sigma = 0}, slope, 1));
  HeightTile tile;
  ASSERT_TRUE(map.extract({0, 0, 2}, tile));  // 4 m, two levels above the leaves, inside the footprint
  EXPECT_DOUBLE_EQ(tile.size, 4.0);
  for (int i = 1; i <= HeightTile::kCells; ++i) {
    for (int j = 1; j <= HeightTile::kCells; ++j) {
      EXPECT_NEAR(tile.at(i, j).depth, slope(i * tile.spacing(), j * tile.spacing()), 1e-4) << i << " " << j;
      EXPECT_NEAR(tile.at(i, j).coverage, 1.0, 1e-6);
      EXPECT_EQ(tile.at(i, j).colour, (Rgb{90, 120, 60}));
    }
  }
  EXPECT_FALSE(map.extract({5, 5, 2}, tile));
}

TEST(QuadtreeMap, TilesOfOneLevelShareTheirEdgeNodes) {
  QuadtreeMap map(reefConfig());
  (void)map.fuse(rangeMesh({.north = 2, .east = 2, .length = 4, .width = 4, .sigma = 0.02}, ripples, 1));
  HeightTile south, north;
  ASSERT_TRUE(map.extract({1, 1, 4}, south));
  ASSERT_TRUE(map.extract({2, 1, 4}, north));
  for (int j = 0; j <= HeightTile::kCells; ++j)
    EXPECT_EQ(south.at(HeightTile::kCells, j).depth, north.at(0, j).depth);
}

TEST(QuadtreeMap, ARevisionGrowsOnlyWhereSomethingChanged) {
  QuadtreeMap map(reefConfig());
  (void)map.fuse(rangeMesh({.north = 0.5, .east = 0.5, .length = 0.8, .width = 0.8}, slope, 1));
  (void)map.fuse(rangeMesh({.north = 5.5, .east = 0.5, .length = 0.8, .width = 0.8}, slope, 2));
  std::map<int, std::uint32_t> revisions;
  map.forEachLeaf([&](const TileKey& key, std::uint32_t revision) { revisions[key.north_index] = revision; });
  EXPECT_EQ(revisions[0], 1u);
  EXPECT_EQ(revisions[5], 2u);
  // A tile shows its northern neighbour's first row: it changes with it.
  (void)map.fuse(rangeMesh({.north = 1.5, .east = 0.5, .length = 1.02, .width = 0.8}, slope, 3));
  map.forEachLeaf([&](const TileKey& key, std::uint32_t revision) { revisions[key.north_index] = revision; });
  EXPECT_EQ(revisions[0], 3u);
  EXPECT_EQ(revisions[5], 2u);
}

TEST(QuadtreeMap, TheSameMeshesGiveTheSameBytes) {
  const auto build = [] {
    QuadtreeMap map(reefConfig(48));
    for (unsigned k = 0; k < 25; ++k)
      (void)map.fuse(
          rangeMesh({.north = 0.9 * k, .east = -0.2 * k, .spacing = k % 4 == 0 ? 0.25 : 0.07}, ripples, k));
    return bytesOf(map);
  };
  EXPECT_EQ(build(), build());
}

TEST(QuadtreeMap, NonsenseInAMeshIsSkippedAndCounted) {
  QuadtreeMap map(reefConfig());
  Mesh mesh = rangeMesh({}, slope, 1);
  mesh.vertices[5].z() = std::numeric_limits<float>::quiet_NaN();
  mesh.vertices[90].x() = 1e9F;
  mesh.sigma[200] = -1;
  mesh.triangles.push_back({0, 1, 4'000'000});
  EXPECT_GT(map.fuse(mesh), 500u);
  EXPECT_GT(map.counters().skipped_triangles, 10u);
  for (const auto& v : toMesh(map).vertices) EXPECT_TRUE(v.allFinite());
  EXPECT_EQ(map.fuse(Mesh{}), 0u);
}

TEST(QuadtreeMap, AConfigurationOutOfRangeIsRefused) {
  QuadtreeConfig config{.max_tiles = 0};
  EXPECT_THROW(QuadtreeMap{config}, std::invalid_argument);
  config = {};
  config.root_size = 24;  // no power of two
  EXPECT_THROW(QuadtreeMap{config}, std::invalid_argument);
  config = {};
  config.root_size = -1;
  EXPECT_THROW(QuadtreeMap{config}, std::invalid_argument);
  config = {};
  config.max_level = 40;
  EXPECT_THROW(QuadtreeMap{config}, std::invalid_argument);
}

TEST(QuadtreeMap, FusingAllocatesNothingEvenWhenTheMapSplitsCoarsensAndIsFull) {
  QuadtreeMap map(reefConfig(48));
  std::vector<Mesh> meshes;
  for (unsigned k = 0; k < 25; ++k)
    meshes.push_back(rangeMesh({.north = 0.9 * k, .spacing = k % 4 == 0 ? 0.25 : 0.07}, ripples, k));
  HeightTile tile;
  int seen = 0;
  const std::function<void(const TileKey&, std::uint32_t)> visit = [&](const TileKey& key, std::uint32_t) {
    seen += map.extract(key, tile) ? 1 : 0;
  };
  const test::ThreadCost before = test::threadCost();
  for (const Mesh& mesh : meshes) {
    (void)map.fuse(mesh);
    map.forEachLeaf(visit);
  }
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_GT(map.counters().coarsened, 0u);
  EXPECT_GT(seen, 100);
}

TEST(QuadtreeMap, MemoryIsFixedByTheConfigurationAndStatedWhole) {
  if (test::sanitized()) GTEST_SKIP() << "a sanitizer keeps the heap's books";
  const auto in_use = [] {
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
  };
  const std::size_t before = in_use();
  QuadtreeMap map(reefConfig(256));
  const double held = static_cast<double>(in_use() - before);
  const std::size_t empty = map.counters().memory_bytes;
  EXPECT_NEAR(static_cast<double>(empty), held, 0.01 * held);
  for (unsigned k = 0; k < 10; ++k) (void)map.fuse(rangeMesh({.north = 2.0 * k}, slope, k));
  EXPECT_EQ(map.counters().memory_bytes, empty);
  EXPECT_NEAR(static_cast<double>(in_use() - before), held, 0.01 * held);
}

TEST(QuadtreeMap, AClearedMapIsANewOneThatNumbersItsChangesOn) {
  QuadtreeConfig config{.max_tiles = 64};
  QuadtreeMap used(config), fresh(config);
  Mesh mesh;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      mesh.vertices.emplace_back(static_cast<float>(i), static_cast<float>(j),
                                 5.0F + 0.1F * static_cast<float>(i * j));
  mesh.triangles = test::latticeTriangles(3, 3);
  Mesh elsewhere = mesh;
  transform(elsewhere, SE3(Eigen::Quaterniond::Identity(), {7, -3, 1}));
  for (int k = 0; k < 5; ++k) (void)used.fuse(elsewhere);
  used.clear(used.fused());
  EXPECT_EQ(used.counters().tiles_used, 0);
  EXPECT_EQ(used.counters().observations, 0u);
  EXPECT_TRUE(toMesh(used).empty());
  EXPECT_EQ(used.fuse(mesh), fresh.fuse(mesh));
  EXPECT_EQ(used.fused(), 6u);
  const Mesh a = toMesh(used), b = toMesh(fresh);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.vertices, b.vertices);
  used.forEachLeaf([](const TileKey&, std::uint32_t revision) { EXPECT_EQ(revision, 6u); });
}

}  // namespace
}  // namespace fathom::fusion

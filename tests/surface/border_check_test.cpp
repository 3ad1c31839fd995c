#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/surface/atlas.hpp"
#include "recon/surface/simplify.hpp"
#include "tests/surface/mesh_checks.hpp"
#include "tests/world/ground.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::surface {
namespace {

using test::BorderCheck, test::BorderReport;

const TileGrid kBorderGrid{.voxel = 0.033, .leaf_voxels = 32};

// Two by eight leaf tiles and the two parents that they have, of the difficult seafloor.
const std::vector<TileMesh>& borderFamily() {
  static const std::vector<TileMesh> tiles = [] {
    std::vector<TileMesh> out;
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 2; ++x)
        out.push_back(simplify(test::syntheticTile(test::difficultTerrain(7), kBorderGrid, {0, x, y}), 1000));
    for (int y = 0; y < 2; ++y) {
      std::vector<const TileMesh*> children;
      for (std::size_t k = 0; k < 8; ++k) children.push_back(&out[8 * static_cast<std::size_t>(y) + k]);
      out.push_back(simplify(joinTiles(children, kBorderGrid, {1, 0, y}), 100));
    }
    return out;
  }();
  return tiles;
}

BorderReport check(const std::vector<TileMesh>& tiles) {
  BorderCheck borders(kBorderGrid);
  for (const TileMesh& tile : tiles) borders.add(tile);
  return borders.run();
}

// A vertex on the side between the leaf tiles (0, 0) and (0, 1) that is no corner.
std::uint32_t borderVertex(const TileMesh& tile) {
  for (std::uint32_t v = 0; v < tile.shared.size(); ++v)
    if (tile.shared[v] == kHighEast) return v;
  throw std::runtime_error("no vertex is shared to the east");
}

TEST(BorderCheck, TilesOfADifficultSurfaceJoinAtAllPairsOfLevels) {
  const BorderReport report = check(borderFamily());
  EXPECT_EQ(report.tiles, 18U);
  // 8 + 14 pairs of leaves, 4 of a leaf and the parent beside it, 1 of parents.
  EXPECT_EQ(report.pairs, 8U + 14U + 4U + 1U);
  EXPECT_GT(report.segments, 1000U);
  EXPECT_EQ(report.crack_count, 0U);
  EXPECT_EQ(report.off_lattice, 0U);
}

TEST(BorderCheck, SeamsOfTheTextureAreNoBorders) {
  std::vector<TileMesh> tiles;
  for (const TileMesh& tile : borderFamily()) tiles.push_back(makeAtlas(tile, {.texel = 0.02}).tile.surface);
  EXPECT_GT(tiles[0].mesh.vertices.size(), borderFamily()[0].mesh.vertices.size());
  const BorderReport report = check(tiles);
  EXPECT_EQ(report.crack_count, 0U);
  EXPECT_EQ(report.segments, check(borderFamily()).segments);
}

TEST(BorderCheck, SeesAVertexThatMovedByOneStepOfTheLattice) {
  std::vector<TileMesh> tiles = borderFamily();
  tiles[0].mesh.vertices[borderVertex(tiles[0])].z() += static_cast<float>(TileGrid::kLattice);
  const BorderReport report = check(tiles);
  // Two segments of either tile, once between the leaves.
  EXPECT_GE(report.crack_count, 4U);
  ASSERT_FALSE(report.cracks.empty());
  const double side = TileGrid::snap(kBorderGrid.box({0, 0, 0})[3]);
  EXPECT_NEAR(report.cracks[0].ends[0].y(), side, 1e-9);
}

TEST(BorderCheck, SeesAVertexThatLeftTheLattice) {
  std::vector<TileMesh> tiles = borderFamily();
  tiles[0].mesh.vertices[borderVertex(tiles[0])].z() += 0.0001F;
  const BorderReport report = check(tiles);
  EXPECT_EQ(report.off_lattice, 1U);
  EXPECT_GE(report.ends + report.crack_count, 2U);
}

TEST(BorderCheck, SeesASideThatWasSimplifiedOnOneSideOnly) {
  std::vector<TileMesh> tiles = borderFamily();
  TileMesh loose = tiles[17];
  std::fill(loose.shared.begin(), loose.shared.end(), std::uint8_t{0});
  tiles[17] = simplify(loose, 50);
  const BorderReport report = check(tiles);
  EXPECT_GT(report.crack_count, 10U);
}

TEST(BorderCheck, SeesATriangleMissingInACoarserLevel) {
  std::vector<TileMesh> tiles = borderFamily();
  TileMesh& parent = tiles[16];
  for (std::size_t t = 0; t < parent.mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = parent.mesh.triangles[t];
    if ((parent.shared[a] & parent.shared[b] & kHighEast) == 0) continue;
    parent.mesh.triangles.erase(parent.mesh.triangles.begin() + static_cast<std::ptrdiff_t>(t));
    break;
  }
  EXPECT_GE(check(tiles).crack_count, 1U);
}

TEST(BorderCheck, TheEndOfTheDataIsNoCrack) {
  std::vector<TileMesh> tiles = {borderFamily()[0], borderFamily()[2]};
  ASSERT_EQ(tiles[1].tile, (TileId{0, 0, 1}));
  tiles[1].mesh.triangles.clear();
  const BorderReport report = check(tiles);
  EXPECT_EQ(report.pairs, 1U);
  EXPECT_EQ(report.crack_count, 0U);
  EXPECT_GT(report.ends, 20U);
}

TEST(BorderCheck, OfNothingFindsNothing) {
  const BorderReport report = check({});
  EXPECT_EQ(report.tiles, 0U);
  EXPECT_EQ(report.pairs, 0U);
  EXPECT_EQ(report.crack_count, 0U);
}

// From fused range meshes to three levels of tiles: the modules' results fit together.

const TileGrid kFusedGrid{.voxel = 0.033,
                          .leaf_voxels = 16};  // leaves of 0.53 m, so that a few meshes fill many

// Rolling ground with a step of 0.6 m, seen by a line of noisy footprints.
std::vector<TileMesh> fusedLeaves() {
  fusion::VolumetricConfig config;
  fusion::VolumetricFusion fusion(config);
  const auto ground = [](double n, double e) {
    return 2.0 + 0.1 * std::sin(3.0 * n) + 0.08 * std::cos(2.5 * e) + 0.3 * std::tanh((e - 1.1) / 0.08);
  };
  for (unsigned k = 0; k < 12; ++k) {
    const double north = 0.4 + 0.3 * k;
    fusion.integrate(test::rangeMesh({.north = north, .east = 1.0, .sigma = 0.006}, ground, k),
                     Eigen::Vector3d(north, 1.0, 0));
  }
  return fusion.extractTiles(kFusedGrid);
}

std::vector<TileMesh> nextLevel(const std::vector<TileMesh>& tiles, double density) {
  std::map<TileId, std::vector<const TileMesh*>> children;
  for (const TileMesh& tile : tiles) children[TileGrid::parent(tile.tile)].push_back(&tile);
  std::vector<TileMesh> out;
  for (const auto& [parent, all] : children)
    out.push_back(simplify(joinTiles(all, kFusedGrid, parent), density));
  return out;
}

TEST(FusedTiles, JoinWithoutCracksOverThreeLevels) {
  std::vector<TileMesh> leaves = fusedLeaves();
  ASSERT_GT(leaves.size(), 20U);
  test::BorderCheck before(kFusedGrid);
  for (TileMesh& leaf : leaves) before.add(leaf);
  const std::uint64_t segments = before.run().segments;
  EXPECT_EQ(before.run().crack_count, 0U);

  SimplifyCounts counts;
  for (TileMesh& leaf : leaves) leaf = simplify(leaf, 1000, &counts);
  EXPECT_EQ(counts.stranded, 0U);
  EXPECT_EQ(counts.pinned, 0U);  // the fused surface is a manifold
  const std::vector<TileMesh> parents = nextLevel(leaves, 100), roots = nextLevel(parents, 10);
  ASSERT_GT(parents.size(), 1U);
  const std::array<const std::vector<TileMesh>*, 3> levels = {&leaves, &parents, &roots};

  test::BorderCheck after(kFusedGrid);
  for (const auto* level : levels)
    for (const TileMesh& tile : *level) after.add(tile);
  const test::BorderReport report = after.run();
  EXPECT_EQ(report.crack_count, 0U);
  EXPECT_EQ(report.off_lattice, 0U);
  EXPECT_GE(report.segments, segments);
  double last = 0;
  for (const auto* level : levels) {
    double error = 0;
    for (const TileMesh& tile : *level) {
      error = std::max(error, tile.error);
      EXPECT_EQ(test::topologyOf(tile.mesh).bad_edges, 0U);
    }
    EXPECT_GT(error, last);
    last = error;
  }
}

}  // namespace
}  // namespace fathom::surface

// From fused range meshes to three levels of tiles: the modules' results fit together.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/surface/simplify.hpp"
#include "tests/fusion/synthetic_footprint.hpp"
#include "tests/surface/border_check.hpp"
#include "tests/surface/mesh_checks.hpp"

namespace fathom::surface {
namespace {

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

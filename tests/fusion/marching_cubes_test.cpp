#include "recon/fusion/marching_cubes.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <map>
#include <random>
#include <set>

#include "recon/fusion/surface_extraction.hpp"
#include "recon/geometry/tile_grid.hpp"

namespace fathom::fusion {
namespace {

TEST(MarchingCubes, NoDiagonalOfAPatternIsInAFaceOfTheCell) {
  const MarchingCubesTable table;
  for (unsigned signs = 0; signs < 256; ++signs) {
    const MarchingCubesTable::Pattern& pattern = table.pattern(signs);
    std::map<std::pair<std::uint8_t, std::uint8_t>, int> sides;
    for (std::size_t t = 0; t < pattern.triangles; ++t)
      for (std::size_t k = 0; k < 3; ++k) ++sides[{pattern.edge[t][k], pattern.edge[t][(k + 1) % 3]}];
    for (const auto& [side, count] : sides) {
      EXPECT_EQ(count, 1);
      const bool diagonal = sides.count({side.second, side.first}) != 0;
      EXPECT_EQ(table.shareFace(side.first, side.second), !diagonal) << signs;
    }
  }
}

// A grid of random voxels: the share `unseen` of them was never seen, the others are inside or outside by
// chance, so that all ambiguous cells occur.
VoxelGrid randomGrid(unsigned seed, double unseen) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::uniform_real_distribution<float> distance(-0.06F, 0.06F);
  VoxelGrid grid;
  for (int b = 0; b < 27; ++b) {
    VoxelBlock& block = grid.make({b % 3 - 1, b / 3 % 3 - 1, b / 9 - 1});
    for (std::size_t v = 0; v < VoxelBlock::kVoxels; ++v) {
      block.distance[v] = uniform(random) < 0.02 ? 0.0F : distance(random);
      block.weight[v] = uniform(random) < unseen ? 0.0F : 1e4F;
      block.observations[v] = 1;
    }
  }
  return grid;
}

// The numbers of edges with more than two triangles or two of one sense, and of vertices with more than
// one fan.
struct Faults {
  std::size_t edges = 0, vertices = 0;
};
Faults faultsOf(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  std::vector<std::vector<std::uint32_t>> around(mesh.vertices.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      ++uses[{mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]}];
      around[mesh.triangles[t][k]].push_back(t);
    }
  Faults faults;
  for (const auto& [edge, count] : uses) faults.edges += count > 1 ? 1 : 0;
  for (std::uint32_t v = 0; v < around.size(); ++v) {
    // Walk from triangle to triangle over shared edges at v.
    std::set<std::uint32_t> left(around[v].begin(), around[v].end());
    std::vector<std::uint32_t> todo = {*left.begin()};
    left.erase(todo[0]);
    while (!todo.empty()) {
      const auto& t = mesh.triangles[todo.back()];
      todo.pop_back();
      for (auto it = left.begin(); it != left.end();) {
        const auto& u = mesh.triangles[*it];
        const auto common = std::count_if(
            t.begin(), t.end(), [&](std::uint32_t a) { return std::find(u.begin(), u.end(), a) != u.end(); });
        if (common == 2) {
          todo.push_back(*it);
          it = left.erase(it);
        } else {
          ++it;
        }
      }
    }
    faults.vertices += left.empty() ? 0 : 1;
  }
  return faults;
}

TEST(MarchingCubes, RandomFieldsWithAndWithoutHolesGiveManifoldsOfDistinctVertices) {
  for (const double unseen : {0.0, 0.02, 0.1, 0.3}) {
    for (unsigned seed = 0; seed < 3; ++seed) {
      const VoxelGrid grid = randomGrid(seed, unseen);
      for (const bool snap : {false, true}) {
        const ExtractedSurface surface = extractSurface(grid, {0.033, 1, snap});
        ASSERT_GT(surface.mesh.triangles.size(), 1000U);
        const Faults faults = faultsOf(surface.mesh);
        EXPECT_EQ(faults.edges, 0U) << unseen;
        EXPECT_EQ(faults.vertices, 0U) << unseen;
        if (!snap) continue;
        std::set<std::array<float, 3>> places;
        for (const auto& v : surface.mesh.vertices) EXPECT_TRUE(places.insert({v.x(), v.y(), v.z()}).second);
        for (const auto& [a, b, c] : surface.mesh.triangles) {
          const auto& p = surface.mesh.vertices;
          EXPECT_GT((p[b] - p[a]).cast<double>().cross((p[c] - p[a]).cast<double>()).norm(), 0.0);
        }
      }
    }
  }
}

TEST(MarchingCubes, OnlyTheOutlineIsOpenWhereAllWasSeen) {
  const ExtractedSurface surface = extractSurface(randomGrid(5, 0.0), {0.033, 1, true});
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const auto& t : surface.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(t[k], t[(k + 1) % 3])];
  // The grid's voxels go from -8 to 15 along each axis.
  const float low = static_cast<float>(TileGrid::snap(-8 * 0.033)),
              high = static_cast<float>(TileGrid::snap(15 * 0.033));
  for (const auto& [edge, count] : uses) {
    if (count == 2) continue;
    const Eigen::Vector3f &a = surface.mesh.vertices[edge.first], &b = surface.mesh.vertices[edge.second];
    bool on_outline = false;
    for (int k = 0; k < 3; ++k) on_outline = on_outline || (a[k] == b[k] && (a[k] == low || a[k] == high));
    EXPECT_TRUE(on_outline);
  }
}

TEST(MarchingCubes, AnUnseenVoxelOpensTheSurfaceOnlyWhereItHasABearingOnIt) {
  for (const float sign : {1.0F, -1.0F}) {
    // A voxel that stands alone: eight cells cut it off by a triangle each.
    const auto triangles = [&](int x, int y, int z) {
      VoxelGrid grid;
      VoxelBlock& block = grid.make({0, 0, 0});
      block.distance.fill(0.02F * sign);
      block.weight.fill(1e4F);
      block.observations.fill(1);
      block.distance[VoxelBlock::local(3, 3, 3)] = -0.01F * sign;
      block.weight[VoxelBlock::local(x, y, z)] = 0;
      return extractSurface(grid, {0.033, 1, true}).mesh.triangles;
    };
    const auto whole = triangles(0, 0, 0);
    ASSERT_EQ(whole.size(), 8U);
    for (const int x : {2, 4})
      for (const int y : {2, 4})
        for (const int z : {2, 4}) EXPECT_EQ(triangles(x, y, z), whole);  // opposite to it in one cell
    EXPECT_EQ(triangles(4, 4, 3).size(), 6U);
    EXPECT_EQ(triangles(4, 3, 3).size(), 4U);
  }
}

}  // namespace
}  // namespace fathom::fusion

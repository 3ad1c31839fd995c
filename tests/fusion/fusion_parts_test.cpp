#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <stdexcept>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/fusion/marching_cubes.hpp"
#include "recon/fusion/surface_extraction.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::Footprint, test::rangeMesh;

Mesh square(double north, double east, double edge, double z) {
  Mesh mesh;
  for (const auto& [n, e] : {std::pair{0.0, 0.0}, {0.0, 1.0}, {1.0, 1.0}, {1.0, 0.0}})
    mesh.vertices.emplace_back(north + n * edge, east + e * edge, z);
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

TEST(CellStatistics, CountsTheCellsThatTheSurfaceCoversHoweverFewVerticesItHas) {
  CellStatistics statistics;
  statistics.add(square(-0.2, 0.3, 1.0, 5));
  const auto cells = statistics.cells();
  ASSERT_EQ(cells.size(), 100U);
  for (std::size_t k = 0; k < cells.size(); ++k) {
    EXPECT_EQ(cells[k].x, -2 + static_cast<int>(k) / 10);
    EXPECT_EQ(cells[k].y, 3 + static_cast<int>(k) % 10);
    EXPECT_EQ(cells[k].meshes, 1U);
    EXPECT_NEAR(cells[k].mean_z, 5, 1e-4);
    EXPECT_EQ(cells[k].deviation, 0);
  }
}

TEST(CellStatistics, ASlopesMeanDepthIsThatOfTheCellsMiddle) {
  CellStatistics statistics;
  const auto slope = [](double n, double e) { return 4 + 0.5 * n - 0.3 * e; };
  statistics.add(rangeMesh({.sigma = 0}, slope, 3));
  int inside = 0;
  for (const auto& cell : statistics.cells()) {
    if (std::abs(cell.x) > 8 || std::abs(cell.y) > 8) continue;
    ++inside;
    EXPECT_NEAR(cell.mean_z, slope((cell.x + 0.5) * 0.1, (cell.y + 0.5) * 0.1), 1e-4);
  }
  EXPECT_EQ(inside, 17 * 17);
}

TEST(CellStatistics, TheDeviationIsThatBetweenMeshes) {
  CellStatistics statistics;
  for (const double z : {2.00, 2.03, 2.06}) statistics.add(square(0, 0, 0.5, z));
  ASSERT_TRUE(statistics.at(0.25, 0.25));
  const auto cell = *statistics.at(0.25, 0.25);
  EXPECT_EQ(cell.meshes, 3U);
  EXPECT_NEAR(cell.mean_z, 2.03, 1e-4);
  EXPECT_NEAR(cell.deviation, 0.03, 1e-4);
  EXPECT_FALSE(statistics.at(0.55, 0.25));
  EXPECT_FALSE(statistics.at(std::numeric_limits<double>::quiet_NaN(), 0));
}

TEST(CellStatistics, MergedGroupsInAnyOrderAreTheSameBytes) {
  const auto floor = [](double n, double e) { return 30 + 0.2 * std::sin(3 * n) + 0.1 * std::cos(5 * e); };
  std::vector<Mesh> meshes;
  for (unsigned k = 0; k < 9; ++k) {
    meshes.push_back(rangeMesh({.north = 0.3 * k}, floor, k));
  }
  CellStatistics whole, first, second;
  for (const Mesh& mesh : meshes) whole.add(mesh);
  for (std::size_t k = 9; k-- > 0;) (k % 2 == 0 ? first : second).add(meshes[k]);
  second.merge(first);
  EXPECT_EQ(whole.save(), second.save());
  EXPECT_THROW(whole.merge(CellStatistics(0.2)), std::invalid_argument);
}

TEST(CellStatistics, SavedStateComesBackAndBrokenStateIsRefused) {
  CellStatistics statistics(0.05);
  statistics.add(square(3, -7, 1, 1234.5));
  statistics.add(square(3, -7, 1, 1234.7));
  const std::vector<std::uint8_t> bytes = statistics.save();
  CellStatistics loaded;
  ASSERT_TRUE(loaded.load(bytes));
  EXPECT_EQ(loaded.save(), bytes);
  EXPECT_EQ(loaded.cell(), 0.05);
  EXPECT_NEAR(loaded.at(3.5, -6.5)->deviation, 0.2 / std::sqrt(2), 1e-4);
  for (std::size_t size = 0; size < bytes.size(); size += 7) {
    const std::vector<std::uint8_t> cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_FALSE(loaded.load(cut)) << size;
  }
  for (std::size_t place = 0; place < 60; ++place) {
    std::vector<std::uint8_t> other = bytes;
    other[place] ^= 0x80;
    CellStatistics spoilt;
    if (spoilt.load(other)) {
      for (const auto& cell : spoilt.cells()) EXPECT_TRUE(std::isfinite(cell.deviation)) << place;
    }
  }
  EXPECT_EQ(loaded.save(), bytes);
}

TEST(CellStatistics, NonsenseTrianglesAreLeftOut) {
  Mesh mesh = square(0, 0, 0.5, 1);
  const auto cells = [](const Mesh& m) {
    CellStatistics statistics;
    statistics.add(m);
    return statistics.cells().size();
  };
  EXPECT_EQ(cells(Mesh()), 0U);
  EXPECT_EQ(cells(mesh), 25U);
  for (const float nonsense : {std::numeric_limits<float>::quiet_NaN(),
                               std::numeric_limits<float>::infinity(), 1e30F, -2e6F, 5000.0F}) {
    Mesh broken = mesh;
    broken.vertices.emplace_back(nonsense, 0, 1);
    broken.triangles.push_back({0, 1, 4});
    EXPECT_EQ(cells(broken), 25U) << nonsense;
  }
  EXPECT_THROW(CellStatistics(0), std::invalid_argument);
}

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

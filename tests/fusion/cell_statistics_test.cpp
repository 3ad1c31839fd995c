#include "recon/fusion/cell_statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "tests/fusion/synthetic_footprint.hpp"

namespace fathom::fusion {
namespace {

using test::Footprint;
using test::rangeMesh;

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
  Footprint footprint;
  footprint.sigma = 0;
  statistics.add(rangeMesh(footprint, slope, 3));
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
    Footprint footprint;
    footprint.north = 0.3 * k;
    meshes.push_back(rangeMesh(footprint, floor, k));
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

}  // namespace
}  // namespace fathom::fusion

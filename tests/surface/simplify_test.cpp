#include "recon/surface/simplify.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "recon/surface/nearest_triangle.hpp"
#include "tests/surface/made_tiles.hpp"
#include "tests/surface/mesh_checks.hpp"

namespace fathom::surface {
namespace {

using test::madeTile;
using test::topologyOf;

double areaOf(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return area;
}

// Segments of the mesh's border whose ends are shared by one side, by position.
std::set<std::array<float, 6>> sharedChain(const TileMesh& tile) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const auto& t : tile.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(t[k], t[(k + 1) % 3])];
  std::set<std::array<float, 6>> chain;
  for (const auto& [edge, n] : uses) {
    if (n != 1 || (tile.shared[edge.first] & tile.shared[edge.second]) == 0) continue;
    std::array<std::array<float, 3>, 2> ends;
    for (std::size_t k = 0; k < 2; ++k) {
      const Eigen::Vector3f& p = tile.mesh.vertices[k == 0 ? edge.first : edge.second];
      ends[k] = {p.x(), p.y(), p.z()};
    }
    std::sort(ends.begin(), ends.end());
    chain.insert({ends[0][0], ends[0][1], ends[0][2], ends[1][0], ends[1][1], ends[1][2]});
  }
  return chain;
}

// Faces whose normal points against that of the nearest place of the other surface.
std::size_t flipped(const Mesh& mesh, const Mesh& original) {
  const NearestTriangle nearest(original);
  std::size_t count = 0;
  const auto normal = [](const Mesh& m, std::size_t t) {
    const auto& [a, b, c] = m.triangles[t];
    return (m.vertices[b] - m.vertices[a]).cross(m.vertices[c] - m.vertices[a]).normalized().eval();
  };
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    const Eigen::Vector3d middle =
        (mesh.vertices[a] + mesh.vertices[b] + mesh.vertices[c]).cast<double>() / 3;
    if (normal(mesh, t).dot(normal(original, nearest(middle).triangle)) < 0) ++count;
  }
  return count;
}

bool onLattice(const Mesh& mesh) {
  for (const Eigen::Vector3f& v : mesh.vertices)
    for (int k = 0; k < 3; ++k)
      if (static_cast<double>(v[k]) != TileGrid::snap(static_cast<double>(v[k]))) return false;
  return true;
}

TEST(Simplify, ReachesTheDensityOfAnOpenSeafloorWithinItsStatedError) {
  const TileMesh fine = madeTile(test::noisyTerrain(0.004, 3), TileGrid{}, {0, 2, -1});
  const double area = areaOf(fine.mesh);
  ASSERT_GT(static_cast<double>(fine.mesh.triangles.size()) / area, 1600);
  const TileMesh coarse = simplify(fine, 1000);

  EXPECT_NEAR(static_cast<double>(coarse.mesh.triangles.size()) / area, 1000, 5);
  EXPECT_GT(coarse.error, 0);
  EXPECT_LT(coarse.error, 0.012);
  EXPECT_TRUE(onLattice(coarse.mesh));
  EXPECT_EQ(flipped(coarse.mesh, fine.mesh), 0U);
  EXPECT_EQ(sharedChain(coarse), sharedChain(fine));
  EXPECT_EQ(coarse.mesh.colours.size(), coarse.mesh.vertices.size());
  EXPECT_EQ(coarse.views, std::vector<std::uint16_t>(coarse.mesh.vertices.size(), 5));
}

}  // namespace
}  // namespace fathom::surface

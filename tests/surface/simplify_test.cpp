#include "recon/surface/simplify.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "recon/surface/atlas.hpp"
#include "recon/surface/surface_error.hpp"
#include "tests/surface/mesh_checks.hpp"
#include "tests/world/ground.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::surface {
namespace {

using test::areaOf, test::syntheticTile, test::topologyOf;

// Segments of the mesh's border with both ends shared by one side, by position.
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

// Faces with a normal against that of the nearest place of the other surface.
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

// The greatest distance of 15 points of each triangle to the other surface.
double sampledDistance(const Mesh& from, const Mesh& to) {
  constexpr int kSteps = 4;
  const NearestTriangle nearest(to);
  double worst = 0;
  for (const auto& [a, b, c] : from.triangles)
    for (int i = 0; i <= kSteps; i += 1)
      for (int j = 0; i + j <= kSteps; j += 1) {
        const Eigen::Vector3d p = (from.vertices[a].cast<double>() * i + from.vertices[b].cast<double>() * j +
                                   from.vertices[c].cast<double>() * (kSteps - i - j)) /
                                  kSteps;
        worst = std::max(worst, nearest(p).squared);
      }
  return std::sqrt(worst);
}

double farthest(const Mesh& a, const Mesh& b) {
  return std::max(sampledDistance(a, b), sampledDistance(b, a));
}

double densityOf(const Mesh& mesh, const Mesh& original) {
  return static_cast<double>(mesh.triangles.size()) / areaOf(original);
}

void expectSameTopology(const Mesh& mesh, const Mesh& original) {
  const test::Topology now = topologyOf(mesh), before = topologyOf(original);
  EXPECT_EQ(now.euler(), before.euler());
  EXPECT_EQ(now.components, before.components);
  EXPECT_EQ(now.bad_edges, 0U);
  EXPECT_EQ(before.bad_edges, 0U);
}

const TileMesh& openSeafloor() {
  static const TileMesh tile = syntheticTile(test::noisyTerrain(0.004, 3), TileGrid{}, {0, 2, -1});
  return tile;
}

const TileMesh& difficultSeafloor() {
  static const TileMesh tile = syntheticTile(test::difficultTerrain(7), TileGrid{}, {0, 0, 0});
  return tile;
}

TEST(Simplify, ReachesTheDensityOfAnOpenSeafloor) {
  const TileMesh& fine = openSeafloor();
  ASSERT_GT(densityOf(fine.mesh, fine.mesh), 1600);
  for (const double density : {1000.0, 300.0, 170.0}) {
    const TileMesh coarse = simplify(fine, density);
    EXPECT_NEAR(densityOf(coarse.mesh, fine.mesh), density, 0.05 * density);
    EXPECT_EQ(flipped(coarse.mesh, fine.mesh), 0U);
    EXPECT_EQ(sharedChain(coarse), sharedChain(fine));
    EXPECT_TRUE(onLattice(coarse.mesh));
    expectSameTopology(coarse.mesh, fine.mesh);
  }
}

TEST(Simplify, ReachesTheDensityOfOverhangsThinWallsHolesAndLooseParts) {
  const TileMesh& fine = difficultSeafloor();
  ASSERT_EQ(topologyOf(fine.mesh).components, 2U);  // with the pebble
  ASSERT_NE(topologyOf(fine.mesh).euler(), 2);
  for (const double density : {1000.0, 300.0, 100.0}) {
    const TileMesh coarse = simplify(fine, density);
    EXPECT_NEAR(densityOf(coarse.mesh, fine.mesh), density, 0.1 * density);
    // A face at the foot of the wall may stand for both of its sides.
    EXPECT_LE(flipped(coarse.mesh, fine.mesh), coarse.mesh.triangles.size() / 200);
    EXPECT_EQ(sharedChain(coarse), sharedChain(fine));
    EXPECT_TRUE(onLattice(coarse.mesh));
    expectSameTopology(coarse.mesh, fine.mesh);
  }
}

TEST(Simplify, StatesAnErrorThatNoPointExceeds) {
  for (const auto& [fine, density] : {std::pair{&openSeafloor(), 1000.0}, {&difficultSeafloor(), 200.0}}) {
    const TileMesh coarse = simplify(*fine, density);
    const double found = farthest(fine->mesh, coarse.mesh);
    EXPECT_LE(found, coarse.error);
    EXPECT_LE(coarse.error, 1.25 * found + TileGrid::kLattice);
  }
}

TEST(Simplify, LosesLessThanTheVoxelsDo) {
  // Rolling ground with 4 mm of noise, at the density of the finest level.
  EXPECT_LT(simplify(openSeafloor(), 1000).error, 0.003);
  EXPECT_LT(simplify(openSeafloor(), 100).error, 0.02);
}

TEST(Simplify, KeepsWhatVerticesCarryWithinWhatTheyCarried) {
  TileMesh fine = openSeafloor();
  for (std::size_t v = 0; v < fine.mesh.vertices.size(); ++v) {
    fine.mesh.sigma[v] = v % 2 == 0 ? 0.004F : 0.008F;
    fine.views[v] = v % 3 == 0 ? 2 : 9;
  }
  const TileMesh coarse = simplify(fine, 500);
  const std::size_t count = coarse.mesh.vertices.size();
  ASSERT_EQ(coarse.mesh.normals.size(), count);
  ASSERT_EQ(coarse.mesh.colours.size(), count);
  ASSERT_EQ(coarse.mesh.sigma.size(), count);
  ASSERT_EQ(coarse.views.size(), count);
  ASSERT_EQ(coarse.shared.size(), count);
  for (std::size_t v = 0; v < count; ++v) {
    EXPECT_GE(coarse.mesh.sigma[v], 0.004F - 1e-7F);
    EXPECT_LE(coarse.mesh.sigma[v], 0.008F + 1e-7F);
    EXPECT_GE(coarse.views[v], 2);
    EXPECT_LE(coarse.views[v], 9);
    EXPECT_EQ(coarse.mesh.colours[v][1], 120);
    EXPECT_NEAR(coarse.mesh.normals[v].norm(), 1, 1e-5);
  }
}

TEST(Simplify, KeepsTheNormalsOnSidesThatTheNeighbourIsLitByToo) {
  const TileMesh& fine = openSeafloor();
  const TileMesh coarse = simplify(fine, 100);
  std::map<std::array<float, 3>, Eigen::Vector3f> before;
  for (std::size_t v = 0; v < fine.shared.size(); ++v) {
    const Eigen::Vector3f& p = fine.mesh.vertices[v];
    if (fine.shared[v] != 0) before[{p.x(), p.y(), p.z()}] = fine.mesh.normals[v];
  }
  std::size_t shared = 0;
  for (std::size_t v = 0; v < coarse.shared.size(); ++v) {
    if (coarse.shared[v] == 0) continue;
    const Eigen::Vector3f& p = coarse.mesh.vertices[v];
    EXPECT_EQ(coarse.mesh.normals[v], (before.at({p.x(), p.y(), p.z()})));
    ++shared;
  }
  EXPECT_EQ(shared, before.size());
}

TEST(Simplify, GivesTheSameBytesAgain) {
  const TileMesh a = simplify(difficultSeafloor(), 300), b = simplify(difficultSeafloor(), 300);
  EXPECT_EQ(a.mesh.vertices, b.mesh.vertices);
  EXPECT_EQ(a.mesh.triangles, b.mesh.triangles);
  EXPECT_EQ(a.mesh.colours, b.mesh.colours);
  EXPECT_EQ(a.mesh.sigma, b.mesh.sigma);
  EXPECT_EQ(a.error, b.error);
}

TEST(Simplify, LeavesATileThatIsCoarseEnough) {
  const TileMesh& fine = openSeafloor();
  const TileMesh same = simplify(fine, 1e6);
  EXPECT_EQ(same.mesh.triangles.size(), fine.mesh.triangles.size());
  EXPECT_EQ(same.error, 0);
  EXPECT_EQ(simplify(TileMesh{}, 100).mesh.triangles.size(), 0U);
}

TEST(Simplify, LeavesTheInsideItsShapeWhereTheBorderAloneHasMoreTrianglesThanAskedFor) {
  const TileMesh& fine = openSeafloor();
  const std::size_t border = sharedChain(fine).size();
  const TileMesh coarse = simplify(fine, 50);
  ASSERT_GT(border, static_cast<std::size_t>(50 * areaOf(fine.mesh)));
  EXPECT_EQ(sharedChain(coarse), sharedChain(fine));
  EXPECT_GE(coarse.mesh.triangles.size(), border + static_cast<std::size_t>(25 * areaOf(fine.mesh)));
  EXPECT_LT(coarse.error, 0.03);
}

TEST(Simplify, StopsWhereOnlySharedVerticesAreLeft) {
  const TileMesh& fine = openSeafloor();
  const TileMesh coarse = simplify(fine, 0);
  EXPECT_EQ(sharedChain(coarse), sharedChain(fine));
  EXPECT_GE(coarse.mesh.triangles.size(), sharedChain(fine).size() - 2);
  expectSameTopology(coarse.mesh, fine.mesh);
}

// A sheet of squares in a plane, 1/16 m wide, normals up.
Mesh sheet(int columns, int rows, const Eigen::Vector3f& origin, const Eigen::Vector3f& right,
           const Eigen::Vector3f& down) {
  Mesh mesh;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i)
      mesh.vertices.emplace_back(origin + right * static_cast<float>(i) / 16 +
                                 down * static_cast<float>(j) / 16);
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const auto at = [&](int di, int dj) {
        return static_cast<std::uint32_t>((j + dj) * (columns + 1) + i + di);
      };
      mesh.triangles.push_back({at(0, 0), at(0, 1), at(1, 1)});
      mesh.triangles.push_back({at(0, 0), at(1, 1), at(1, 0)});
    }
  return mesh;
}

// Both meshes, vertices of one place joined.
TileMesh welded(const Mesh& a, const Mesh& b) {
  TileMesh out;
  std::map<std::array<float, 3>, std::uint32_t> number;
  for (const Mesh* mesh : {&a, &b})
    for (const auto& t : mesh->triangles) {
      std::array<std::uint32_t, 3> triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        const Eigen::Vector3f& p = mesh->vertices[t[k]];
        const auto [found, fresh] = number.try_emplace({p.x(), p.y(), p.z()}, out.mesh.vertices.size());
        if (fresh) out.mesh.vertices.push_back(p);
        triangle[k] = found->second;
      }
      out.mesh.triangles.push_back(triangle);
    }
  return out;
}

TEST(Simplify, KeepsFourSheetsAlongOneEdgeTogether) {
  const Eigen::Vector3f east(0, 1, 0), south(-1, 0, 0), up(0, 0, -1);
  // A wall through the middle of a floor: four faces at each edge of the line where they meet.
  const TileMesh tile =
      welded(sheet(16, 16, {1, 0, 2}, east, south), sheet(16, 16, {0.5F, 0, 2.5F}, east, up));
  SimplifyCounts counts;
  const TileMesh coarse = simplify(tile, 100, &counts);
  EXPECT_GT(counts.pinned, 16U);
  EXPECT_EQ(counts.stranded, 0U);
  EXPECT_LT(coarse.mesh.triangles.size(), tile.mesh.triangles.size() / 4);
  EXPECT_LE(farthest(tile.mesh, coarse.mesh), coarse.error);
  EXPECT_LT(coarse.error, 0.001);
  // All 16 edges are there yet, each with its four faces.
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const auto& t : coarse.mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(t[k], t[(k + 1) % 3])];
  EXPECT_EQ(std::count_if(uses.begin(), uses.end(), [](const auto& edge) { return edge.second == 4; }), 16);
}

TEST(Simplify, KeepsTwoSheetsThatTouchInAPoint) {
  const Eigen::Vector3f east(0, 1, 0), south(-1, 0, 0);
  const TileMesh tile =
      welded(sheet(8, 8, {1, 0, 2}, east, south), sheet(8, 8, {0.5F, 0.5F, 2}, east, south));
  const TileMesh coarse = simplify(tile, 10);
  const auto touching =
      std::count(coarse.mesh.vertices.begin(), coarse.mesh.vertices.end(), Eigen::Vector3f(0.5F, 0.5F, 2));
  EXPECT_EQ(touching, 1);
  EXPECT_EQ(topologyOf(coarse.mesh).components, 1U);
  EXPECT_NEAR(areaOf(coarse.mesh), 0.5, 1e-6);
}

TEST(Simplify, KeepsFacesOnEitherSideOfASheetThatIsPaperThin) {
  const Eigen::Vector3f east(0, 1, 0), south(-1, 0, 0);
  Mesh front = sheet(8, 8, {1, 0, 2}, east, south), back = front;
  for (auto& t : back.triangles) std::swap(t[1], t[2]);
  const TileMesh tile = welded(front, back);
  const TileMesh coarse = simplify(tile, 10);
  EXPECT_NEAR(areaOf(coarse.mesh), 0.5, 1e-6);
  EXPECT_LE(farthest(tile.mesh, coarse.mesh), coarse.error + 1e-9);
}

TEST(Simplify, ClosesAHoleOfOneTriangleAndLeavesALooseOne) {
  TileMesh tile;
  tile.mesh = sheet(8, 8, {1, 0, 2}, {0, 1, 0}, {-1, 0, 0});
  tile.mesh.triangles.erase(tile.mesh.triangles.begin() + 54);
  const auto corner = static_cast<std::uint32_t>(tile.mesh.vertices.size());
  for (const float along : {0.0F, 0.1F, 0.2F}) tile.mesh.vertices.emplace_back(3, along, along * along);
  tile.mesh.triangles.push_back({corner, corner + 1, corner + 2});
  SimplifyCounts counts;
  const TileMesh coarse = simplify(tile, 200, &counts);
  EXPECT_EQ(counts.closed, 1U);
  EXPECT_EQ(topologyOf(coarse.mesh).components, 2U);
  EXPECT_EQ(topologyOf(coarse.mesh).euler(), 2);  // two sheets without holes
  EXPECT_LT(coarse.mesh.triangles.size(), tile.mesh.triangles.size());
}

TEST(Simplify, ClosesAHoleOnlyWhereTheLevelsTrianglesAreLarger) {
  const auto holed = [](int cells) {  // in the middle of a square metre
    TileMesh tile;
    tile.mesh = sheet(16, 16, {1, 0, 2}, {0, 1, 0}, {-1, 0, 0});
    auto& triangles = tile.mesh.triangles;
    for (int row = 5 + cells; row-- > 5;)
      triangles.erase(triangles.begin() + 2 * (16 * row + 5), triangles.begin() + 2 * (16 * row + 5 + cells));
    return tile;
  };
  SimplifyCounts counts;
  EXPECT_EQ(topologyOf(simplify(holed(1), 400, &counts).mesh).euler(), 0);
  EXPECT_EQ(topologyOf(simplify(holed(6), 50, &counts).mesh).euler(), 0);
  EXPECT_EQ(counts.closed, 0U);
  const TileMesh coarse = simplify(holed(1), 50, &counts);
  EXPECT_EQ(counts.closed, 1U);
  EXPECT_EQ(topologyOf(coarse.mesh).euler(), 1);
  EXPECT_LE(coarse.mesh.triangles.size(), 50U);
}

TEST(Simplify, DropsTrianglesOfFewerThanThreeCorners) {
  TileMesh tile;
  tile.mesh = sheet(4, 4, {1, 0, 2}, {0, 1, 0}, {-1, 0, 0});
  tile.mesh.triangles.push_back({3, 3, 4});
  const TileMesh coarse = simplify(tile, 1e6);
  EXPECT_EQ(coarse.mesh.triangles.size(), 32U);
}

TEST(JoinTiles, JoinsWhatTheSeamsOfAnAtlasDoubled) {
  const TileGrid grid;
  const TileMesh tile = simplify(difficultSeafloor(), 500);
  const TileMesh doubled = makeAtlas(tile, {.texel = 0.02}).tile.surface;
  ASSERT_GT(doubled.mesh.vertices.size(), tile.mesh.vertices.size());
  const TileMesh joined = joinTiles({&doubled}, grid, {1, 0, 0});
  EXPECT_EQ(joined.mesh.vertices.size(), tile.mesh.vertices.size());
  expectSameTopology(joined.mesh, tile.mesh);
}

TEST(JoinTiles, WeldsWhatTilesShareAndKeepsTheBordersOfAllOfThem) {
  const TileGrid grid{.voxel = 0.033, .leaf_voxels = 32};
  std::vector<TileMesh> tiles;
  for (int x = 0; x < 4; ++x)
    for (int y = 0; y < 4; ++y)
      tiles.push_back(syntheticTile(test::noisyTerrain(0.004, 3), grid, {0, x - 4, y}, 1.5, 2.5));
  std::vector<const TileMesh*> pointers;
  for (const TileMesh& tile : tiles) pointers.push_back(&tile);
  const TileMesh joined = joinTiles(pointers, grid, {1, -1, 0});
  const test::Topology topology = topologyOf(joined.mesh);
  EXPECT_EQ(topology.components, 1U);
  EXPECT_EQ(topology.euler(), 1);  // a sheet without holes
  EXPECT_EQ(topology.bad_edges, 0U);
  EXPECT_EQ(topology.border_edges, sharedChain(joined).size());
  EXPECT_EQ(joined.mesh.colours.size(), joined.mesh.vertices.size());
  for (std::size_t v = 0; v < joined.shared.size(); ++v)
    EXPECT_EQ(joined.shared[v], sidesOf(joined.mesh.vertices[v], grid, {1, -1, 0}));
  EXPECT_EQ(joinTiles({}, grid, {1, 0, 0}).mesh.vertices.size(), 0U);
}

// By rounding its parts cross that wall at nearly every corner.
TEST(DistanceBound, HoldsForATriangleWhosePartsAreSliversAlongAWall) {
  Mesh from, to;
  from.vertices = {{-2.50976562F, 0.0844726562F, 13.6352539F},
                   {-2.54101562F, 0.0629882812F, 13.6279297F},
                   {-2.54345703F, 0.100585938F, 13.597168F}};
  from.triangles = {{0, 1, 2}};
  to.vertices = {{-2.54394531F, 0.0991210938F, 13.5961914F},
                 {-2.54101562F, 0.0991210938F, 13.6030273F},
                 {-2.54101562F, 0.0659179688F, 13.6269531F},
                 {-2.54101562F, 0.109375F, 13.5961914F},
                 {-2.51367188F, 0.0991210938F, 13.6289062F}};
  to.triangles = {{0, 1, 2}, {0, 3, 1}, {2, 1, 4}, {4, 1, 3}};
  const NearestTriangle nearest(to);
  double least = 0;
  for (const Eigen::Vector3f& p : from.vertices)
    least = std::max(least, std::sqrt(nearest(p.cast<double>()).squared));
  const double bound = distanceBound(from, to, 0.0005);
  EXPECT_GE(bound, least);
  EXPECT_LE(bound, 1.1 * least + 0.001);
}

}  // namespace
}  // namespace fathom::surface

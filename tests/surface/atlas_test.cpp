#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "recon/surface/simplify.hpp"
#include "tests/surface/synthetic_tiles.hpp"

namespace fathom::surface {
namespace {

using test::syntheticTile;

constexpr AtlasConfig kConfig{.texel = 0.006, .max_edge = 4096, .gutter = 4};

Atlas difficultAtlas() {
  return makeAtlas(simplify(syntheticTile(test::difficultTerrain(7), TileGrid{}, {0, 0, 0}), 1000), kConfig);
}

std::vector<Texel> allTexels(const Atlas& atlas) {
  std::vector<Texel> texels;
  rasterise(atlas, 0, atlas.height, texels);
  return texels;
}

Eigen::Vector3d corner(const Mesh& mesh, std::size_t face, std::size_t k) {
  return mesh.vertices[mesh.triangles[face][k]].cast<double>();
}

Eigen::Vector3d faceNormal(const Mesh& mesh, std::size_t face) {
  const Eigen::Vector3d a = corner(mesh, face, 0);
  return (corner(mesh, face, 1) - a).cross(corner(mesh, face, 2) - a).normalized();
}

// Weights of the face's corners at a point of its plane.
Eigen::Vector3d barycentric(const Mesh& mesh, std::size_t face, const Eigen::Vector3d& p) {
  Eigen::Matrix3d corners;
  for (int k = 0; k < 3; ++k) corners.col(k) = corner(mesh, face, static_cast<std::size_t>(k));
  const Eigen::Vector3d n = faceNormal(mesh, face), a = corners.col(0);
  const double area = (corners.col(1) - a).cross(corners.col(2) - a).dot(n);
  Eigen::Vector3d w;
  for (int k = 0; k < 3; ++k)
    w[k] = (corners.col((k + 1) % 3) - p).cross(corners.col((k + 2) % 3) - p).dot(n) / area;
  return w;
}

TEST(Atlas, ShowsAnOpenSeafloorFromAboveOnALatticeThatNeighboursContinue) {
  const TileGrid grid;
  const auto ground = test::noisyTerrain(0.004, 3);
  for (const int y : {0, 1}) {
    const Atlas atlas = makeAtlas(syntheticTile(ground, grid, {0, 0, y}), {.texel = 0.0012});
    ASSERT_EQ(atlas.charts.size(), 1U);
    // The tile, a gutter, and what blocks of four texels add.
    EXPECT_NEAR(atlas.width, 1760 + 2 * 4, 8);
    EXPECT_NEAR(atlas.height, 1760 + 2 * 4, 8);
    const Chart& chart = atlas.charts[0];
    EXPECT_TRUE(chart.along.isApprox(Eigen::Vector3d(0, 0, 1)));
    // Blocks begin at multiples of four texels of the whole model.
    const double east = (chart.origin.y() - 0.0006) / 0.0048, south = (-chart.origin.x() - 0.0006) / 0.0048;
    EXPECT_NEAR(east, std::round(east), 1e-6);
    EXPECT_NEAR(south, std::round(south), 1e-6);
  }
}

TEST(Atlas, GivesEveryFaceAPlaceThatItsAxisSees) {
  const Atlas atlas = difficultAtlas();
  const Mesh& mesh = atlas.tile.surface.mesh;
  ASSERT_EQ(atlas.chart_of_face.size(), mesh.triangles.size());
  EXPECT_EQ(atlas.width % 4, 0);
  EXPECT_EQ(atlas.height % 4, 0);
  EXPECT_LT(atlas.charts.size(), 40U);
  std::size_t badly_seen = 0;
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    const Chart& chart = atlas.charts[atlas.chart_of_face[f]];
    if (faceNormal(mesh, f).dot(-chart.along) < 0.24) ++badly_seen;
    for (const std::uint32_t v : mesh.triangles[f]) {
      const double column = static_cast<double>(mesh.texture_coordinates[v].x()) * atlas.width;
      const double row = (1 - static_cast<double>(mesh.texture_coordinates[v].y())) * atlas.height;
      // A gutter is between it and the next chart.
      EXPECT_GE(column, chart.x + 4 - 1e-3);
      EXPECT_LE(column, chart.x + chart.width - 4 + 1e-3);
      EXPECT_GE(row, chart.y + 4 - 1e-3);
      EXPECT_LE(row, chart.y + chart.height - 4 + 1e-3);
      const Eigen::Vector3d p =
          chart.origin + (column - chart.x - 0.5) * chart.right + (row - chart.y - 0.5) * chart.down;
      const Eigen::Vector3d apart = mesh.vertices[v].cast<double>() - p;
      EXPECT_LT((apart - chart.along * chart.along.dot(apart)).norm(), 1e-5);
    }
  }
  EXPECT_LE(badly_seen, mesh.triangles.size() / 200);
}

TEST(Atlas, ChartsDoNotOverlap) {
  const Atlas atlas = difficultAtlas();
  std::vector<int> taken(static_cast<std::size_t>(atlas.width * atlas.height), 0);
  for (const Chart& chart : atlas.charts)
    for (int y = chart.y; y < chart.y + chart.height; ++y)
      for (int x = chart.x; x < chart.x + chart.width; ++x)
        ++taken[static_cast<std::size_t>(y * atlas.width + x)];
  EXPECT_EQ(*std::max_element(taken.begin(), taken.end()), 1);
}

TEST(Atlas, NoFaceHidesAnotherOfItsChart) {
  const Atlas atlas = difficultAtlas();
  const Mesh& mesh = atlas.tile.surface.mesh;
  const std::vector<Texel> texels = allTexels(atlas);
  // Every texel centre well inside a face's outline shows this face.
  std::size_t checked = 0;
  for (std::size_t f = 0; f < mesh.triangles.size(); ++f) {
    const Chart& chart = atlas.charts[atlas.chart_of_face[f]];
    std::array<Eigen::Vector2d, 3> at;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = corner(mesh, f, k) - chart.origin;
      at[k] = {chart.x + p.dot(chart.right) / chart.right.squaredNorm(),
               chart.y + p.dot(chart.down) / chart.down.squaredNorm()};
    }
    const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      return a.x() * b.y() - a.y() * b.x();
    };
    const double area = cross(at[1] - at[0], at[2] - at[0]);
    const Eigen::Vector2d low = at[0].cwiseMin(at[1]).cwiseMin(at[2]),
                          high = at[0].cwiseMax(at[1]).cwiseMax(at[2]);
    for (int y = static_cast<int>(low.y()); y <= high.y(); ++y)
      for (int x = static_cast<int>(low.x()); x <= high.x(); ++x) {
        const Eigen::Vector2d p(x, y);
        double least = 1;
        for (std::size_t k = 0; k < 3; ++k)
          least = std::min(least, cross(at[(k + 1) % 3] - p, at[(k + 2) % 3] - p) / area);
        if (least < 1e-3) continue;
        ++checked;
        EXPECT_EQ(texels[static_cast<std::size_t>(y * atlas.width + x)].face, static_cast<int>(f));
      }
  }
  EXPECT_GT(checked, 100000U);
}

TEST(Atlas, TexelsAreOnTheirFaceAtItsTextureCoordinates) {
  const Atlas atlas = difficultAtlas();
  const Mesh& mesh = atlas.tile.surface.mesh;
  const std::vector<Texel> texels = allTexels(atlas);
  std::size_t inside = 0, gutter = 0;
  for (int y = 0; y < atlas.height; ++y)
    for (int x = 0; x < atlas.width; ++x) {
      const Texel& texel = texels[static_cast<std::size_t>(y * atlas.width + x)];
      if (texel.face < 0) continue;
      const auto f = static_cast<std::size_t>(texel.face);
      const Eigen::Vector3d p = texel.point.cast<double>();
      const Eigen::Vector3d w = barycentric(mesh, f, p);
      if (w.minCoeff() < -1e-4) {
        ++gutter;
        // Four texels aside, and no steeper than 45 degrees.
        const Eigen::Vector3d centre = (corner(mesh, f, 0) + corner(mesh, f, 1) + corner(mesh, f, 2)) / 3;
        double radius = 0;
        for (std::size_t k = 0; k < 3; ++k) radius = std::max(radius, (corner(mesh, f, k) - centre).norm());
        EXPECT_LT((p - centre).norm(), radius + 4.01 * std::sqrt(2.0) * atlas.tile.texel);
        continue;
      }
      ++inside;
      EXPECT_NEAR((p - corner(mesh, f, 0)).dot(faceNormal(mesh, f)), 0, 2e-6);
      Eigen::Vector2d st = Eigen::Vector2d::Zero();
      for (int k = 0; k < 3; ++k)
        st += w[k] * mesh.texture_coordinates[mesh.triangles[f][static_cast<std::size_t>(k)]].cast<double>();
      EXPECT_NEAR(st.x() * atlas.width, x + 0.5, 5e-3);
      EXPECT_NEAR((1 - st.y()) * atlas.height, y + 0.5, 5e-3);
    }
  EXPECT_GT(inside, 100000U);
  EXPECT_GT(gutter, 5000U);
}

TEST(Atlas, RowsDrawnApartAreThoseDrawnTogether) {
  const Atlas atlas = difficultAtlas();
  const std::vector<Texel> whole = allTexels(atlas);
  std::vector<Texel> band;
  std::size_t next = 0;
  for (int row = 0; row < atlas.height; row += 37) {
    rasterise(atlas, row, std::min(37, atlas.height - row), band);
    for (const Texel& texel : band) {
      ASSERT_EQ(texel.face, whole[next].face);
      ASSERT_EQ(texel.point, whole[next].point);
      ++next;
    }
  }
  EXPECT_EQ(next, whole.size());
}

TEST(Atlas, LargerTexelsWhereItWouldBeTooLarge) {
  const TileMesh tile = syntheticTile(test::noisyTerrain(0.004, 3), TileGrid{}, {0, 0, 0});
  const Atlas atlas = makeAtlas(tile, {.texel = 0.0012, .max_edge = 512});
  EXPECT_LE(std::max(atlas.width, atlas.height), 512);
  EXPECT_GT(atlas.tile.texel, 0.0041);
  EXPECT_LT(atlas.tile.texel, 0.0056);
}

TEST(Atlas, OfNothingIsEmpty) {
  const Atlas atlas = makeAtlas(TileMesh{}, kConfig);
  EXPECT_EQ(atlas.width, 0);
  EXPECT_TRUE(atlas.charts.empty());
  std::vector<Texel> texels(3);
  rasterise(atlas, 0, 0, texels);
  EXPECT_TRUE(texels.empty());
  EXPECT_TRUE(bakeFromChildren(atlas, {}).empty());
}

}  // namespace
}  // namespace fathom::surface

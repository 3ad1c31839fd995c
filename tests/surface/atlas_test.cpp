#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"
#include "recon/surface/simplify.hpp"
#include "tests/world/tiles.hpp"

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

// A colour for every place, in which a shift of 1 cm is two levels.
std::array<double, 3> paint(const Eigen::Vector3d& p) {
  return {128 + 100 * std::sin(2 * p.x()), 128 + 100 * std::sin(2 * p.y()), 128 + 100 * std::sin(2 * p.z())};
}

TexturedTile painted(const TileMesh& surface, double texel) {
  Atlas atlas = makeAtlas(surface, {.texel = texel});
  std::vector<Texel> texels;
  rasterise(atlas, 0, atlas.height, texels);
  RgbImage& image = atlas.tile.atlas;
  image = {atlas.width, atlas.height, std::vector<std::uint8_t>(3 * texels.size(), 0)};
  std::vector<std::uint8_t> known(texels.size(), 0);
  for (std::size_t i = 0; i < texels.size(); ++i) {
    if (texels[i].face < 0) continue;
    known[i] = 1;
    const auto colour = paint(texels[i].point.cast<double>());
    for (std::size_t c = 0; c < 3; ++c)
      image.rgb[3 * i + c] = static_cast<std::uint8_t>(std::lround(colour[c]));
  }
  fillUnknown(image, known);
  return atlas.tile;
}

struct Family {
  std::vector<TexturedTile> children;
  Atlas parent;
};

Family bakedFamily(const test::Ground& ground, double child_texel) {
  const TileGrid grid;
  Family out;
  std::vector<TileMesh> fine;
  for (const auto& [x, y] : {std::pair{0, 0}, {0, 1}, {1, 0}, {1, 1}})
    fine.push_back(simplify(test::syntheticTile(ground, grid, {0, x, y}), 1000));
  std::vector<const TileMesh*> tiles;
  for (const TileMesh& tile : fine) {
    out.children.push_back(painted(tile, child_texel));
    tiles.push_back(&tile);
  }
  out.parent = makeAtlas(simplify(joinTiles(tiles, grid, {1, 0, 0}), 100), {.texel = 0.024});
  return out;
}

bool within(const Mesh& mesh, const Texel& texel) {
  const auto& [a, b, c] = mesh.triangles[static_cast<std::size_t>(texel.face)];
  const Eigen::Vector3f n = (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
  for (const auto& [from, to] : {std::pair{a, b}, {b, c}, {c, a}})
    if ((mesh.vertices[to] - mesh.vertices[from]).cross(texel.point - mesh.vertices[from]).dot(n) < 0)
      return false;
  return true;
}

// Share of the parent's own texels (no gutters) that differ by more than `levels`.
double wrongShare(const Atlas& parent, const RgbImage& image, double levels) {
  std::vector<Texel> texels;
  rasterise(parent, 0, parent.height, texels);
  std::size_t own = 0, wrong = 0;
  for (std::size_t i = 0; i < texels.size(); ++i) {
    if (texels[i].face < 0 || !within(parent.tile.surface.mesh, texels[i])) continue;
    ++own;
    const auto expected = paint(texels[i].point.cast<double>());
    bool off = false;
    for (std::size_t c = 0; c < 3; ++c) off |= std::abs(image.rgb[3 * i + c] - expected[c]) > levels;
    wrong += off ? 1 : 0;
  }
  EXPECT_GT(own, 20000U);
  return static_cast<double>(wrong) / static_cast<double>(own);
}

TEST(BakeFromChildren, GivesTheParentTheColoursOfItsChildrenInTheSamePlaces) {
  Family made = bakedFamily(test::noisyTerrain(0.006, 7), 0.006);
  std::vector<const TexturedTile*> children;
  for (const TexturedTile& child : made.children) children.push_back(&child);
  const RgbImage image = bakeFromChildren(made.parent, children);
  ASSERT_EQ(image.width, made.parent.width);
  ASSERT_EQ(image.height, made.parent.height);
  EXPECT_LT(wrongShare(made.parent, image, 8), 0.05);
  EXPECT_LT(wrongShare(made.parent, image, 40), 0.005);
}

TEST(BakeFromChildren, QuartersOfTheChildrenAreEnough) {
  Family made = bakedFamily(test::difficultTerrain(7), 0.006);
  std::vector<TexturedTile> quarters;
  std::vector<const TexturedTile*> children;
  for (const TexturedTile& child : made.children) quarters.push_back(quarterAtlas(child));
  for (const TexturedTile& quarter : quarters) children.push_back(&quarter);
  const RgbImage image = bakeFromChildren(made.parent, children);
  EXPECT_LT(wrongShare(made.parent, image, 8), 0.05);
  EXPECT_LT(wrongShare(made.parent, image, 40), 0.01);
}

TEST(FillUnknown, GivesEveryTexelAColourBetweenItsNeighboursAndLeavesTheKnown) {
  RgbImage image{9, 5, std::vector<std::uint8_t>(3 * 45, 0)};
  std::vector<std::uint8_t> known(45, 0);
  image.at(0, 0)[0] = 100;
  image.at(8, 4)[0] = 200;
  known[0] = known[44] = 1;
  fillUnknown(image, known);
  EXPECT_EQ(image.at(0, 0)[0], 100);
  EXPECT_EQ(image.at(8, 4)[0], 200);
  EXPECT_EQ(image.at(1, 1)[0], 100);
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 9; ++x) {
      EXPECT_GE(image.at(x, y)[0], 100);
      EXPECT_LE(image.at(x, y)[0], 200);
      EXPECT_EQ(image.at(x, y)[1], 0);
    }
}

TEST(FillUnknown, LeavesAnImageThatKnowsNothing) {
  RgbImage image{3, 3, std::vector<std::uint8_t>(27, 7)};
  fillUnknown(image, std::vector<std::uint8_t>(9, 0));
  EXPECT_EQ(image.rgb, std::vector<std::uint8_t>(27, 7));
}

TEST(QuarterAtlas, IsTheMeanOfFourByFourTexelsAndKeepsTheSurface) {
  TexturedTile tile;
  tile.texel = 0.25;
  tile.surface.mesh.vertices = {{1, 2, 3}};
  tile.atlas = {8, 4, std::vector<std::uint8_t>(3 * 8 * 4, 10)};
  for (int y = 0; y < 4; ++y)
    for (int x = 4; x < 8; ++x) tile.atlas.at(x, y)[1] = static_cast<std::uint8_t>(x % 2 == 0 ? 0 : 201);

  const TexturedTile quarter = quarterAtlas(tile);

  EXPECT_EQ(quarter.atlas.width, 2);
  EXPECT_EQ(quarter.atlas.height, 1);
  EXPECT_EQ(quarter.atlas.rgb, (std::vector<std::uint8_t>{10, 10, 10, 10, 101, 10}));
  EXPECT_DOUBLE_EQ(quarter.texel, 1);
  EXPECT_EQ(quarter.surface.mesh.vertices, tile.surface.mesh.vertices);
}

// Two faces of a square, light on its left and dark on its right.
TEST(VertexColours, AreTheTexturesMeanAboutEachVertexInAnyChart) {
  TexturedTile tile;
  tile.texel = 0.1;
  Mesh& mesh = tile.surface.mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}, {3, 4, 5}};
  mesh.texture_coordinates = {{0, 0}, {0, 1}, {1, 1}, {0, 0}, {1, 1}, {1, 0}};
  tile.atlas = {20, 20, std::vector<std::uint8_t>(3 * 20 * 20, 40)};
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 10; ++x) tile.atlas.at(x, y)[0] = 200;
  colourVertices(tile);
  ASSERT_EQ(mesh.colours.size(), mesh.vertices.size());
  EXPECT_EQ(mesh.colours[1], (Rgb{200, 40, 40}));
  EXPECT_EQ(mesh.colours[5], (Rgb{40, 40, 40}));
  EXPECT_EQ(mesh.colours[0], mesh.colours[3]);  // one place
  EXPECT_EQ(mesh.colours[2], mesh.colours[4]);
  EXPECT_GT(mesh.colours[0][0], 150);
  EXPECT_LT(mesh.colours[2][0], 90);
}

}  // namespace
}  // namespace fathom::surface

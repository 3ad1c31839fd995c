#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>

#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"
#include "recon/surface/fill.hpp"
#include "recon/surface/simplify.hpp"
#include "tests/surface/synthetic_tiles.hpp"

namespace fathom::surface {
namespace {

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

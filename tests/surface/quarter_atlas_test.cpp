#include <gtest/gtest.h>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {
namespace {

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
TEST(VertexColours, AreTheTexturesMeanAboutEachVertexWhicheverChartItStandsIn) {
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

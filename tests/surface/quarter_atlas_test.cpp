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

}  // namespace
}  // namespace fathom::surface

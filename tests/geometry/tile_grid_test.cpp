#include "recon/geometry/tile_grid.hpp"

#include <gtest/gtest.h>

namespace fathom {
namespace {

TEST(TileGrid, ParentCoversFourByFourChildrenOnEitherSideOfTheOrigin) {
  for (int x = -9; x <= 9; ++x) {
    const TileId up = TileGrid::parent({0, x, -x});
    EXPECT_EQ(up.level, 1);
    EXPECT_LE(4 * up.x, x);
    EXPECT_LT(x, 4 * up.x + 4);
    EXPECT_LE(4 * up.y, -x);
    EXPECT_LT(-x, 4 * up.y + 4);
  }
}

TEST(TileGrid, FindsTheTileOfAPlaceAtEveryLevel) {
  const TileGrid grid;
  for (int level = 0; level < 4; ++level) {
    const TileId tile = grid.at(level, -7.3, 1234.5);
    const auto box = grid.box(tile);
    EXPECT_LE(box[0], -7.3);
    EXPECT_GT(box[2], -7.3);
    EXPECT_LE(box[1], 1234.5);
    EXPECT_GT(box[3], 1234.5);
  }
}

TEST(TileGrid, LatticeIsExactInSinglePrecisionUpToEightKilometres) {
  for (const double value : {0.0331, -8191.99, 1234.56789}) {
    const double snapped = TileGrid::snap(value);
    EXPECT_NEAR(snapped, value, TileGrid::kLattice / 2);
    EXPECT_EQ(static_cast<double>(static_cast<float>(snapped)), snapped);
  }
}

}  // namespace
}  // namespace fathom

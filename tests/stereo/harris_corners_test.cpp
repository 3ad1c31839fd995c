#include "recon/stereo/harris_corners.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>

namespace fathom::stereo {
namespace {

GrayLevel levelOf(int width, int height, int (*value)(int, int)) {
  GrayLevel level;
  level.resize(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) level.row(y)[x] = static_cast<std::uint8_t>(value(x, y));
  level.extendBorder();
  return level;
}

// 8-pixel squares: corners where four of them meet.
int chessboard(int x, int y) {
  return (x / 8 + y / 8) % 2 == 0 ? 40 : 200;
}

TEST(HarrisCorners, CornersOfAChessboardAreFoundWhereItsSquaresMeet) {
  const GrayLevel level = levelOf(96, 80, chessboard);
  HarrisCorners harris(96, 200, fastestKernels());
  const auto& corners = harris.find(level, {0, 0, 96, 80}, 4, 200);
  EXPECT_EQ(corners.size(), 11U * 9U);
  // Squares meet in the middle between the pixels 7 and 8. Windows centred up to 1.5 px away hold the same
  // gradients, so that the measure is the same there.
  for (const Corner& c : corners) {
    EXPECT_LE(std::abs((c.x + 4) % 8 - 3.5), 1.5) << c.x;
    EXPECT_LE(std::abs((c.y + 4) % 8 - 3.5), 1.5) << c.y;
  }
}

TEST(HarrisCorners, EdgesAndFlatGroundAndRampsAreNoCorners) {
  HarrisCorners harris(96, 200, fastestKernels());
  for (const GrayLevel& level : {levelOf(64, 64, [](int x, int) { return x < 32 ? 20 : 220; }),
                                 levelOf(64, 64, [](int, int) { return 90; }),
                                 levelOf(64, 64, [](int x, int y) { return x + 2 * y; })})
    EXPECT_TRUE(harris.find(level, {0, 0, 64, 64}, 7, 100).empty());
}

TEST(HarrisCorners, BoxMarginAndNumberAreKept) {
  const GrayLevel level = levelOf(96, 80, chessboard);
  HarrisCorners harris(96, 200, fastestKernels());
  for (const Corner& c : harris.find(level, {20, 10, 60, 50}, 4, 200)) {
    EXPECT_TRUE(c.x >= 20 && c.x < 60 && c.y >= 10 && c.y < 50);
  }
  for (const Corner& c : harris.find(level, {0, 0, 96, 80}, 17, 200)) {
    EXPECT_TRUE(c.x >= 17 && c.x < 96 - 17 && c.y >= 17 && c.y < 80 - 17);
  }
  EXPECT_EQ(harris.find(level, {0, 0, 96, 80}, 4, 10).size(), 10U);
  EXPECT_TRUE(harris.find(level, {0, 0, 96, 80}, 48, 10).empty());
  EXPECT_TRUE(harris.find(level, {50, 50, 20, 20}, 4, 10).empty());
}

}  // namespace
}  // namespace fathom::stereo

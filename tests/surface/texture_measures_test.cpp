#include "recon/surface/texture_measures.hpp"

#include <gtest/gtest.h>

namespace fathom::surface {
namespace {

RgbImage checked(int width, int height, int low, int high) {
  RgbImage image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        image.at(x, y)[c] = static_cast<std::uint8_t>((x + y) % 2 == 0 ? low : high);
  return image;
}

TEST(SeamMeasure, TellsAStepAtABorderFromTheTextureBesideIt) {
  RgbImage image = checked(20, 10, 100, 104);
  std::vector<std::uint64_t> region(200);
  for (int y = 0; y < 10; ++y) {
    for (int x = 0; x < 20; ++x) {
      region[static_cast<std::size_t>(20 * y + x)] = x < 10 ? 1 : 2;
      if (x >= 10)
        for (int c = 0; c < 3; ++c) image.at(x, y)[c] = static_cast<std::uint8_t>(image.at(x, y)[c] + 40);
    }
  }
  const SeamMeasure seams = measureSeams(image, region);
  EXPECT_EQ(seams.pairs_across, 10U);
  EXPECT_EQ(seams.pairs_inside, 10U * 18 + 9 * 20);
  EXPECT_DOUBLE_EQ(seams.inside, 4);
  EXPECT_DOUBLE_EQ(seams.across, 40);
  EXPECT_DOUBLE_EQ(seams.ratio(), 10);
}

TEST(SeamMeasure, IsOneWhereBordersDoNotShow) {
  const RgbImage image = checked(20, 10, 100, 104);
  std::vector<std::uint64_t> region(200, 1);
  for (std::size_t i = 0; i < 100; ++i) region[i] = 2;
  for (std::size_t i = 0; i < 200; i += 20) region[i] = kNoRegion;
  EXPECT_DOUBLE_EQ(measureSeams(image, region).ratio(), 1);
}

TEST(SeamMeasure, OfTwoTexturesWeighsThemByTheirTexels) {
  SeamMeasure a{10, 4, 1, 100};
  a += {20, 2, 3, 100};
  EXPECT_DOUBLE_EQ(a.across, 17.5);
  EXPECT_DOUBLE_EQ(a.inside, 3);
  EXPECT_DOUBLE_EQ((SeamMeasure{} += SeamMeasure{}).ratio(), 0);
}

TEST(GradientEnergy, IsTheSquaredSlopeOfARampWhereAllNeighboursCount) {
  RgbImage ramp{20, 10, std::vector<std::uint8_t>(600)};
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x)
      for (int c = 0; c < 3; ++c) ramp.at(x, y)[c] = static_cast<std::uint8_t>(3 * x + 4 * y);
  std::vector<std::uint8_t> counts(200, 1);
  EXPECT_NEAR(gradientEnergy(ramp, counts).mean(), 25, 1e-9);
  EXPECT_EQ(gradientEnergy(ramp, counts).texels, 18U * 8);
  counts[20 * 5 + 10] = 0;
  EXPECT_EQ(gradientEnergy(ramp, counts).texels, 18U * 8 - 9);
  EXPECT_DOUBLE_EQ(gradientEnergy(ramp, std::vector<std::uint8_t>(200, 0)).mean(), 0);
}

TEST(GradientEnergy, LooksPastThePatternOfSinglePixels) {
  EXPECT_DOUBLE_EQ(gradientEnergy(checked(20, 10, 100, 108), std::vector<std::uint8_t>(200, 1)).mean(), 0);
}

}  // namespace
}  // namespace fathom::surface

#include "recon/geometry/sea_water.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace fathom {
namespace {

TEST(SeaWater, DepthMatchesTheCheckValueOfTheUnescoPaper) {
  EXPECT_NEAR(depthFromPressure(1e8, 30.0 * std::numbers::pi / 180), 9712.653, 0.001);
  EXPECT_EQ(depthFromPressure(0, 0.5), 0);
}

TEST(SeaWater, OneDensityGivesTheSameDepthWhereTheOceanHasIt) {
  // Near the surface the standard ocean has 1028.1 kg/m3.
  EXPECT_NEAR(depthFromPressure(1e5, 0.7, 1028.1), depthFromPressure(1e5, 0.7), 0.005);
  // A lake's water is lighter: the same pressure is deeper.
  EXPECT_NEAR(depthFromPressure(1e5, 0.7, 1000.0) / depthFromPressure(1e5, 0.7), 1.028, 0.001);
}

TEST(SeaWater, SoundSpeedMatchesMackenziesCheckValueAndKnowsItsBounds) {
  EXPECT_NEAR(soundSpeed(25, 35, 1000), 1550.744, 0.001);
  EXPECT_TRUE(soundSpeedIsKnown(25, 35, 1000));
  EXPECT_FALSE(soundSpeedIsKnown(25, 0.3, 10));
  EXPECT_FALSE(soundSpeedIsKnown(-1, 35, 10));
}

TEST(SeaWater, SalinityMatchesTheCheckValuesOfTheUnescoPaper) {
  // Ratios to the conductivity of standard sea water; degrees of 1968 there.
  constexpr double kStandard = 4.2914, kIts68 = 1.00024, kDecibar = 1e4;
  EXPECT_NEAR(practicalSalinity(1.0 * kStandard, 15 / kIts68, 0), 35.000000, 1e-5);
  EXPECT_NEAR(practicalSalinity(1.2 * kStandard, 20 / kIts68, 2000 * kDecibar), 37.245628, 1e-5);
  EXPECT_NEAR(practicalSalinity(0.65 * kStandard, 5 / kIts68, 1500 * kDecibar), 27.995347, 1e-5);
  EXPECT_TRUE(std::isnan(practicalSalinity(0.001, 15, 0)));
  EXPECT_TRUE(std::isnan(practicalSalinity(4, 60, 0)));
  EXPECT_TRUE(std::isnan(practicalSalinity(std::nan(""), 15, 0)));
}

}  // namespace
}  // namespace fathom

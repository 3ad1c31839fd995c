#include "recon/geometry/sea_water.hpp"

#include <gmock/gmock.h>

#include <cmath>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom {
namespace {

TEST(SeaWater, DepthMatchesTheCheckValueOfTheUnescoPaper) {
  EXPECT_NEAR(depthFromPressure(1e8, degreesToRadians(30.0)), 9712.653, 0.001);
  EXPECT_EQ(depthFromPressure(0, 0.5), 0);
}

TEST(SeaWater, OneDensityGivesTheSameDepthWhereTheOceanHasIt) {
  // Near the surface the standard ocean has 1028.1 kg/m3.
  EXPECT_NEAR(depthFromPressure(1e5, 0.7, 1028.1), depthFromPressure(1e5, 0.7), 0.005);
  // A lake's water is lighter: the same pressure is deeper.
  EXPECT_NEAR(depthFromPressure(1e5, 0.7, 1000.0) / depthFromPressure(1e5, 0.7), 1.028, 0.001);
}

TEST(SeaWater, SoundSpeedMatchesTheCheckValueOfTheUnescoPaperAndKnowsItsBounds) {
  constexpr double kIts68 = 1.00024, kDecibar = 1e4;
  EXPECT_NEAR(soundSpeedAtPressure(40 / kIts68, 40, 10000 * kDecibar), 1731.995, 0.001);
  // Its table of section 9: salinity, degrees of 1968, no pressure.
  EXPECT_NEAR(soundSpeedAtPressure(0, 25, 0), 1435.8, 0.05);
  EXPECT_NEAR(soundSpeedAtPressure(20 / kIts68, 35, 0), 1521.5, 0.05);
  // Fresh water by Del Grosso and Mader (1972), JASA 52: 1482.34 m/s at 20 deg C.
  EXPECT_NEAR(soundSpeedAtPressure(20, 0, 0), 1482.34, 0.1);
  EXPECT_TRUE(std::isnan(soundSpeedAtPressure(-3, 35, 0)));
  EXPECT_TRUE(std::isnan(soundSpeedAtPressure(10, 41, 0)));
  EXPECT_TRUE(std::isnan(soundSpeedAtPressure(10, 35, -1)));
  EXPECT_TRUE(std::isnan(soundSpeedAtPressure(std::nan(""), 35, 0)));
}

TEST(SeaWater, SoundSpeedAtADepthIsThatOfTheOceansPressureThere) {
  // Mackenzie (1981), JASA 70: 1550.744 m/s at 25 deg C, 35 psu, 1,000 m. At pressure Chen and Millero have
  // 0.6 m/s more (Spiesberger and Metzger 1991, J. Geophys. Res. 96).
  EXPECT_NEAR(soundSpeed(25, 35, 1000), 1550.744 + 0.6, 0.1);
  EXPECT_NEAR(soundSpeed(25, 35, 0), 1534.4, 0.2);
  EXPECT_TRUE(std::isfinite(soundSpeed(0.5, 3, 10)));
  EXPECT_TRUE(std::isfinite(soundSpeed(-1.5, 34, 100)));
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

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // [ns]

TEST(Tide, IsTheSinusoidOfTheMissionFromItsStartOn) {
  const auto tide = readTide("sinusoid amplitude_m=1.5 period_s=1200 phase_rad=0.5", kStart);
  ASSERT_TRUE(tide);
  EXPECT_NEAR(tide->heightAt(kStart), 1.5 * std::sin(0.5), 1e-9);
  EXPECT_NEAR(tide->heightAt(kStart + 300'000'000'000), 1.5 * std::cos(0.5), 1e-6);
}

TEST(Tide, AModelThatIsNotKnownIsRefusedWithTheFormThatIs) {
  try {
    (void)readTide("harmonic", kStart);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::AllOf(::testing::HasSubstr("tide_model"),
                                               ::testing::HasSubstr("sinusoid amplitude_m=A")));
  }
  EXPECT_FALSE(readTide("none", kStart));
}

}  // namespace
}  // namespace fathom

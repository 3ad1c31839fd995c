#include "recon/navigation/graph/navigation_config.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

#include "realtime/base/input_error.hpp"

namespace fathom::slam {
namespace {

SensorNoise read(const char* toml) {
  const ConfigTable root = ConfigTable::parse(toml, "test.toml");
  const SensorNoise noise = readKeys(root.table("sensors"), SensorNoise{}, visitSensorNoise);
  root.finish();
  return noise;
}

TEST(NavigationConfig, AnAbsentTableGivesTheDefaults) {
  EXPECT_EQ(read("").heading, SensorNoise{}.heading);
  EXPECT_EQ(read("").depth_drift, SensorNoise{}.depth_drift);
}

TEST(NavigationConfig, AnglesAreDegreesInTheFileAndRadiansInside) {
  const SensorNoise noise = read("[sensors]\nheading_deg = 2.0\ndvl_scale = 0.01\ndepth_drift = 0.002\n");
  EXPECT_NEAR(noise.heading, 0.0349066, 1e-6);
  EXPECT_EQ(noise.dvl_scale, 0.01);
  EXPECT_EQ(noise.depth_drift, 0.002);
}

TEST(NavigationConfig, OutOfRangeAndUnknownKeysAreErrors) {
  EXPECT_THROW(read("[sensors]\nheading_deg = 0\n"), InputError);
  EXPECT_THROW(read("[sensors]\ngyro = 1\n"), InputError);
}

TEST(NavigationConfig, AnErrorNamesTheValueOutOfRange) {
  const auto errorOf = [](const auto& config) -> std::string {
    try {
      config.validate();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  SensorNoise noise;
  EXPECT_EQ(errorOf(noise), "");
  noise.tilt = -0.5;
  EXPECT_EQ(errorOf(noise), "sensor noise: tilt = -0.5, must be above 0");
  NavigationConfig config;
  config.known_scale = 0.25;
  EXPECT_EQ(errorOf(config), "navigation graph: known_scale = 0.25, must be 1 or more");
}

TEST(NavigationConfig, WithoutATideModelTheSeasHeightIsUnknown) {
  SensorNoise noise;
  noise.depth_offset = 0.1;
  EXPECT_NEAR(withTide(noise, false).depth_offset, 0.51, 0.01);
  EXPECT_LT(withTide(noise, true).tide_rate, 0.2 * noise.tide_rate);
}

}  // namespace
}  // namespace fathom::slam

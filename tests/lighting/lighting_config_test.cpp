#include "recon/lighting/lighting_config.hpp"

#include <gtest/gtest.h>

#include <string>

#include "realtime/base/input_error.hpp"

namespace fathom::lighting {
namespace {

LightingConfig read(const std::string& text) {
  const ConfigTable root = ConfigTable::parse(text, "config.toml");
  LightingConfig config = readKeys(root.table("lighting"), LightingConfig{}, visitLighting);
  root.finish();
  return config;
}

TEST(LightingConfigFile, ReadsEveryKeyAndKeepsDefaultsForTheRest) {
  const LightingConfig config = read(
      "[lighting]\ntarget_mean = 0.5\ntarget_sigma = 0.2\nmin_images = 4\ngrid_px = 32\nsaturated = 0.9\n"
      "outlier_sigma = 4\nmemory_images = 500\nmodel = \"range\"\n");
  EXPECT_EQ(config.target_mean, 0.5);
  EXPECT_EQ(config.target_sigma, 0.2);
  EXPECT_EQ(config.min_images, 4);
  EXPECT_EQ(config.grid, 32);
  EXPECT_EQ(config.saturated, 0.9);
  EXPECT_EQ(config.outlier, 4.0);
  EXPECT_EQ(config.memory, 500);
  EXPECT_EQ(config.choice, LightingChoice::kRangeDependent);
  EXPECT_EQ(read("").grid, LightingConfig().grid);
  EXPECT_EQ(read("").choice, LightingChoice::kAuto);
}

TEST(LightingConfigFile, EveryModelHasAName) {
  for (const LightingChoice choice : {LightingChoice::kAuto, LightingChoice::kWholeImage,
                                      LightingChoice::kPlain, LightingChoice::kRangeDependent})
    EXPECT_EQ(read("[lighting]\nmodel = \"" + std::string(nameOf(choice)) + "\"\n").choice, choice);
}

TEST(LightingConfigFile, WrongValuesAndMisspeltKeysAreRefused) {
  for (const char* text : {"target_mean = 1.5", "grid_px = 1", "grid_px = 4000", "model = \"best\"",
                           "model = 3", "saturated = 0", "outlier_sigma = 0.5", "grid = 8", "min_images = 0"})
    EXPECT_THROW((void)read(std::string("[lighting]\n") + text + "\n"), InputError) << text;
}

}  // namespace
}  // namespace fathom::lighting

#include "recon/topside/config/topside_config.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <string>

#include "tests/support/key_tables.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

std::string configError(const std::string& text) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << text;
  return test::refusal([&] { (void)readTopsideConfig(folder.path() / "run.toml"); });
}

TEST(TopsideConfig, AnUnknownKeyOrAValueOutOfRangeIsNamed) {
  EXPECT_THAT(configError("[fusion]\nvoxels_m = 0.02\n"), ::testing::HasSubstr("voxels_m"));
  EXPECT_THAT(configError("[fusion]\nvoxel_m = -1\n"), ::testing::HasSubstr("voxel_m"));
  EXPECT_THAT(configError("[stereo]\nwindow_px = 14\n"), ::testing::HasSubstr("odd"));
  EXPECT_THAT(configError("[stereo]\nmin_range_m = 5\nmax_range_m = 2\n"),
              ::testing::HasSubstr("max_range_m"));
  EXPECT_THAT(configError("[slam]\nturned_sigmas = 0\n"), ::testing::HasSubstr("turned_sigmas"));
  EXPECT_THAT(configError("[model]\ntexel_m = 0.00001\n"), ::testing::HasSubstr("texel_m"));
  EXPECT_EQ(configError("[fusion]\nvoxel_m = 0.05\n[stereo]\nmax_features = 1000\n"), "");
}

TEST(TopsideConfig, WhenTheCompassContradictsALinkCanBeSaid) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << "[slam]\nturned_sigmas = 2.5\n";
  EXPECT_EQ(readTopsideConfig(folder.path() / "run.toml").navigation.turned_sigmas, 2.5);
}

TEST(TopsideConfig, WhatIsPrintedReadsAsTheSameAndThePagesHaveIt) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "run.toml";
  std::ofstream(file) << "[fusion]\nvoxel_m = 0.05\ncarve = false\n[stereo]\nmethod = \"dense\"\n";
  const std::string printed = topsideToml(readTopsideConfig(file));
  EXPECT_THAT(printed,
              ::testing::HasSubstr("voxel_m = 0.05  # [m] 0.002 to 2.0, default 0.033: edge of a voxel\n"));
  std::ofstream(file) << printed;
  EXPECT_EQ(topsideToml(readTopsideConfig(file)), printed);

  TopsideConfig defaults;
  ConfigListing listing;
  visitTopside(listing, defaults);
  test::expectPagesHoldKeys(FATHOM_SOURCE_DIR "/recon", "topside", listing);
}

TEST(TopsideConfig, TheBandFollowsTheVoxelUnlessItIsSet) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << "[fusion]\nvoxel_m = 0.1\n";
  EXPECT_DOUBLE_EQ(readTopsideConfig(folder.path() / "run.toml").fusion.truncation, 0.3);
  std::ofstream(folder.path() / "run.toml") << "[fusion]\nvoxel_m = 0.1\ntruncation_m = 0.15\n";
  EXPECT_DOUBLE_EQ(readTopsideConfig(folder.path() / "run.toml").fusion.truncation, 0.15);
}

}  // namespace
}  // namespace fathom::topside

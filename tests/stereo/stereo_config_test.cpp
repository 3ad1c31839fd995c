#include <gmock/gmock.h>
#include <string>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::stereo {
namespace {

using ::testing::AllOf, ::testing::HasSubstr;

SparseStereoConfig read(const char* toml) {
  const ConfigTable root = ConfigTable::parse(toml, "test.toml");
  const SparseStereoConfig config = readKeys(root.table("stereo"), SparseStereoConfig{}, visitSparseStereo);
  root.finish();
  return config;
}

std::string errorOf(const char* toml) {
  return test::refusal([&] { read(toml); });
}

TEST(StereoConfig, AnAbsentTableGivesTheDefaults) {
  const SparseStereoConfig config = read("");
  EXPECT_EQ(config.max_features, SparseStereoConfig{}.max_features);
  EXPECT_EQ(config.max_epipolar_distance, SparseStereoConfig{}.max_epipolar_distance);
}

TEST(StereoConfig, EveryKeyReachesItsMember) {
  const SparseStereoConfig c = read(
      "[stereo]\nmax_features = 21\nwindow_px = 9\nmax_epipolar_px = 0.2\nmax_left_right_px = 0.3\n"
      "min_correlation = 0.4\nsigma_scale = 0.5\nsearch_radius_px = 60\nmin_range_m = 0.7\n"
      "max_range_m = 8\nmax_edge_m = 0.9\nmin_patch_points = 10\n");
  EXPECT_EQ(c.max_features, 21);
  EXPECT_EQ(c.window, 9);
  EXPECT_EQ(c.max_epipolar_distance, 0.2);
  EXPECT_EQ(c.max_left_right_distance, 0.3);
  EXPECT_EQ(c.min_correlation, 0.4);
  EXPECT_EQ(c.sigma_scale, 0.5);
  EXPECT_EQ(c.search_radius, 60);
  EXPECT_EQ(c.min_range, 0.7);
  EXPECT_EQ(c.max_range, 8);
  EXPECT_EQ(c.max_edge, 0.9);
  EXPECT_EQ(c.min_patch_points, 10);
}

TEST(StereoConfig, ValuesThatCannotBeAreRefusedByNameAndLine) {
  EXPECT_THAT(errorOf("[stereo]\nwindow_px = 8\n"), AllOf(HasSubstr("window_px"), HasSubstr("odd")));
  EXPECT_THAT(errorOf("[stereo]\nmax_features = 5001\n"), HasSubstr("max_features"));
  EXPECT_THAT(errorOf("[stereo]\nmin_range_m = 5\nmax_range_m = 4\n"), HasSubstr("max_range_m"));
  EXPECT_THAT(errorOf("[stereo]\nmax_epipolar_distance_px = 1\n"), HasSubstr("max_epipolar_distance_px"));
}

}  // namespace
}  // namespace fathom::stereo

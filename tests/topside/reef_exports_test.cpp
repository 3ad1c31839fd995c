#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/exports/colmap_model.hpp"
#include "recon/topside/exports/sparse_model_input.hpp"
#include "tests/topside/colmap_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

// What the run of the reef left, taken up again.
SparseModel taken(const RunPlaces& places, const TopsideConfig& config) {
  StageStore store(places.work, StageStore::Access::kShared);
  RunProgress progress(1.0);
  Dive dive(openMission(places.mission, places.input), config, store, progress, {Stage::kLevel, {}});
  return sparseModelOf(dive);
}

TEST_F(ReefQuick, ColmapsModelOfARunHoldsMeasuredPixelsAPixelFromWhereItsPointsProject) {
  const SparseModel model = taken(run(), {});
  writeColmapModel(out_->path() / "sparse", model, ColmapFormat::kBinary);
  const test::ColmapFiles read(out_->path() / "sparse");
  EXPECT_EQ(read.images.size(), 2 * done_.pairs);
  double sum = 0, pixels = 0, joined = 0, coloured = 0;
  for (const auto& [id, point] : read.points) {
    const double error = read.errorOf(point), views = static_cast<double>(point.track.size());
    EXPECT_NEAR(point.error, error, 1e-3);
    sum += error * views;
    pixels += views;
    joined += views > 2 ? 1 : 0;
    coloured += point.colour != std::array<std::uint8_t, 3>{128, 128, 128} ? 1 : 0;
  }
  const double points = static_cast<double>(read.points.size());
  std::printf("%.0f points, %.0f pixels, %.3f px, %.1f %% of the points in several pairs\n", points, pixels,
              sum / pixels, 100 * joined / points);
  EXPECT_LT(sum / pixels, 0.21);  // twice what was measured
  EXPECT_GT(joined, 0.2 * points);
  EXPECT_GT(coloured, 0.99 * points);
  for (const auto& [id, image] : read.images)
    EXPECT_TRUE(std::filesystem::exists(kReefMission / "img" / image.name)) << image.name;
}

TEST_F(ReefQuick, OtherSettingsThanTheRunsAreRefusedAndNothingIsMade) {
  TopsideConfig config;
  config.slam_features = 300;
  EXPECT_THROW((void)taken(run(), config), InputError);
}

}  // namespace
}  // namespace fathom::topside

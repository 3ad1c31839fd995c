#include "recon/topside/commands/calibrate_command.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

CalibrateOptions optionsFor(const std::filesystem::path& images, const std::filesystem::path& out) {
  CalibrateOptions options;
  options.board = {"9x6", 0.024, {}};
  options.board.images.images = {images};
  options.out = out;
  return options;
}

std::string errorOf(const CalibrateOptions& options) {
  return test::refusal([&] { (void)runCalibrate(options); });
}

TEST(Calibrate, RealChessboardsGiveThePublishedRig) {
  FATHOM_REQUIRE_DATA("calibration/left01.jpg");
  const test::TemporaryFolder folder;
  const auto out = folder.path() / "stereo.calib";
  const auto done = runCalibrate(optionsFor(test::dataFile("calibration"), out));
  std::printf("%zu views, stereo RMS %.4f px, baseline %.3f mm\n", done.views.size(), done.stereo_rms,
              1e3 * done.rig.baseline());
  EXPECT_GE(done.views.size(), 24u);
  EXPECT_LE(done.stereo_rms, 0.17);                   // published: 0.164 px
  EXPECT_NEAR(done.rig.baseline(), 0.09205, 0.0003);  // published: 92.05 mm
  EXPECT_LT(done.sigma.baseline, 0.0003);

  const StereoRig read = readStereoCalib(out);
  EXPECT_NEAR(read.baseline(), done.rig.baseline(), 1e-12);
  EXPECT_EQ(read.left.width, 640);
  std::ifstream json_file(out.string() + ".json");
  const auto json = nlohmann::json::parse(json_file);
  EXPECT_EQ(json["views"].size(), done.views.size());
  EXPECT_NEAR(json["rms_px"]["stereo"].get<double>(), done.stereo_rms, 1e-12);
  EXPECT_GT(json["left"]["fx"]["sigma"].get<double>(), 0.0);
  EXPECT_TRUE(std::filesystem::exists(out.string() + ".html"));
}

TEST(Calibrate, TheThirdRadialCoefficientIsEstimatedOnlyWhenAskedFor) {
  FATHOM_REQUIRE_DATA("calibration/left01.jpg");
  const test::TemporaryFolder folder;
  auto options = optionsFor(test::dataFile("calibration"), folder.path() / "stereo.calib");
  const auto without = runCalibrate(options);
  EXPECT_EQ(readStereoCalib(options.out).left.k3, 0.0);
  options.config.k3 = true;
  const auto with = runCalibrate(options);
  EXPECT_NE(readStereoCalib(options.out).left.k3, 0.0);
  EXPECT_GT(with.sigma.left.k3, 0.0);
  EXPECT_LE(with.stereo_rms, without.stereo_rms + 1e-6);
}

TEST(Calibrate, ARealDiveDeterminesItsRigWithoutABoard) {
  FATHOM_REQUIRE_DATA("real/haltbrekken/stereo.calib");
  const test::TemporaryFolder folder, dive;
  for (const char* side : {"left", "right"}) {  // pairs 1 to 9, which overlap well
    std::filesystem::create_directory(dive.path() / side);
    for (const char* number : {"01", "02", "03", "04", "05", "06", "07", "08", "09"}) {
      const std::string name = std::string(side) + "/" + number + ".png";
      std::filesystem::create_symlink(test::dataFile("real/haltbrekken") / name, dive.path() / name);
    }
  }
  CalibrateOptions options;
  options.self = true;
  options.baseline = 0.305;
  options.board.images.images = {dive.path()};
  options.out = folder.path() / "stereo.calib";
  const StereoRig found = runCalibrate(options).rig;
  const StereoRig given = readStereoCalib(test::dataFile("real/haltbrekken/stereo.calib"));
  const double turn = (found.T_right_left * given.T_right_left.inverse()).log().tail<3>().norm();
  std::printf("focal lengths off by %.2f, %.2f, %.2f, %.2f %%, the rig's turn by %.3f degrees\n",
              100 * (found.left.fx / given.left.fx - 1), 100 * (found.left.fy / given.left.fy - 1),
              100 * (found.right.fx / given.right.fx - 1), 100 * (found.right.fy / given.right.fy - 1),
              57.3 * turn);
  for (const double Camera::*focal : {&Camera::fx, &Camera::fy}) {
    EXPECT_NEAR(found.left.*focal / given.left.*focal, 1, 0.02);
    EXPECT_NEAR(found.right.*focal / given.right.*focal, 1, 0.01);
  }
  EXPECT_LT(turn, 0.2 / 57.3);
  EXPECT_NEAR(found.baseline(), 0.305, 1e-9);
}

TEST(Calibrate, AWrongBoardSizeIsOneClearLineAndWritesNothing) {
  FATHOM_REQUIRE_DATA("calibration/left01.jpg");
  const test::TemporaryFolder folder;
  auto options = optionsFor(test::dataFile("calibration/left01.jpg"), folder.path() / "stereo.calib");
  options.board.images.images.push_back(test::dataFile("calibration/right01.jpg"));
  options.board.size = "8x5";
  EXPECT_THAT(errorOf(options), HasSubstr("no whole board of 8 x 5 inner corners"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  options.board.size = "9by6";
  EXPECT_THAT(errorOf(options), HasSubstr("such as 9x6"));
}

TEST(Calibrate, NeitherABoardNorADiveIsOneClearLine) {
  EXPECT_THAT(errorOf({}),
              HasSubstr("--board: is missing; give --board and --square, or --self and --baseline"));
}

TEST(Calibrate, OnePairIsTooFew) {
  FATHOM_REQUIRE_DATA("calibration/left01.jpg");
  const test::TemporaryFolder folder;
  auto options = optionsFor(test::dataFile("calibration/left01.jpg"), folder.path() / "stereo.calib");
  EXPECT_THAT(errorOf(options), HasSubstr("no right image belongs to it"));
  options.board.images.images.push_back(test::dataFile("calibration/right01.jpg"));
  EXPECT_THAT(errorOf(options), HasSubstr("at least 4 are needed"));
}

TEST(Calibrate, AnAbsentFileAndOneThatIsNoImageAreNamed) {
  const test::TemporaryFolder folder;
  EXPECT_THAT(errorOf(optionsFor(folder.path() / "nowhere", folder.path() / "a.calib")),
              HasSubstr("nowhere: is not there"));
  EXPECT_THAT(errorOf(optionsFor(folder.path(), folder.path() / "a.calib")), HasSubstr("no pair"));
  for (const char* name : {"left1.png", "right1.png"}) std::ofstream(folder.path() / name) << "no picture";
  EXPECT_THAT(errorOf(optionsFor(folder.path(), folder.path() / "a.calib")), HasSubstr("left1.png"));
}

}  // namespace
}  // namespace fathom::topside

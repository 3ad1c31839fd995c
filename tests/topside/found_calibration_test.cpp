#include <gmock/gmock.h>

#include "recon/geometry/camera.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::topside {
namespace {

using test::replaced, testing::Contains, testing::HasSubstr;

// OpenCV's names, in millimetres, without the size of the images.
const std::string kCalibration = R"({"K1": [[70, 0, 31], [0, 70, 23], [0, 0, 1]], "D1": [0.1, 0, 0, 0],
 "K2": [[71, 0, 30], [0, 71, 22], [0, 0, 1]], "D2": [0.1, 0, 0, 0],
 "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [-200, 0, 0]})";

// A folder of one pair, left 64 x 48 and right 60 x 44, with a calibration that is found there.
class FoundCalibration : public testing::Test {
 protected:
  void SetUp() override {
    writeImage("left/1.pgm", 64, 48);
    writeImage("right/1.pgm", 60, 44);
    test::writeText(calib_, kCalibration);
  }
  void writeImage(const char* name, int width, int height) {
    test::writeText(folder_.path() / name, "P5 " + std::to_string(width) + " " + std::to_string(height) +
                                               " 255\n" +
                                               std::string(static_cast<std::size_t>(width * height), 'a'));
  }
  [[nodiscard]] MissionInput open() const { return openMission(folder_.path(), options_); }
  [[nodiscard]] std::string refusal() const {
    return test::refusal([&] { (void)open(); });
  }
  [[nodiscard]] Digest rigKey() const {
    Hasher hasher;
    addRig(hasher, open());
    return hasher.finish();
  }

  test::TemporaryFolder folder_;
  std::filesystem::path calib_ = folder_.path() / "rig.json";
  InputOptions options_{.calib_unit = 0.001};
};

TEST_F(FoundCalibration, IsSaidAndTakesTheImagesSizes) {
  const MissionInput input = open();
  EXPECT_EQ(input.rig.left.width, 64);
  EXPECT_EQ(input.rig.left.height, 48);
  EXPECT_EQ(input.rig.right.width, 60);
  EXPECT_EQ(input.rig.right.height, 44);
  EXPECT_NEAR(input.rig.baseline(), 0.2, 1e-15);
  EXPECT_THAT(input.assumed, Contains("calibration: OpenCV rig.json (left K1, right K2), baseline 0.200 m"));
}

TEST_F(FoundCalibration, OfOtherImagesIsRefused) {
  writeImage("left/1.pgm", 32, 20);
  EXPECT_THAT(refusal(), HasSubstr("rig.json: left: the principal point 31.0 23.0 is outside"));
  options_.calib_unit.reset();
  EXPECT_THAT(refusal(), HasSubstr("--calib-unit mm"));
}

TEST_F(FoundCalibration, IsOneOfSeveralWhenNamed) {
  test::writeText(folder_.path() / "other.json", replaced(kCalibration, "-200", "-300"));
  EXPECT_THAT(refusal(), HasSubstr("several calibrations (other.json, rig.json)"));
  options_.calib = folder_.path() / "other.json";
  EXPECT_NEAR(open().rig.baseline(), 0.3, 1e-15);
}

TEST_F(FoundCalibration, ImagesThatAreLinksAreNamedInPlace) {
  const test::TemporaryFolder elsewhere;
  std::filesystem::rename(folder_.path() / "left/1.pgm", elsewhere.path() / "1.pgm");
  std::filesystem::create_symlink(elsewhere.path() / "1.pgm", folder_.path() / "left/1.pgm");
  const MissionInput input = open();
  ASSERT_EQ(input.files->pairs.size(), 1u);
  EXPECT_EQ(input.files->pairs[0].left, "left/1.pgm");
  EXPECT_EQ(input.paths.images() / "left/1.pgm", folder_.path() / "left/1.pgm");
}

TEST_F(FoundCalibration, ImagesOutsideTheFolderAreNamedFromAboveBoth) {
  const std::filesystem::path dive = folder_.path() / "dive";
  std::filesystem::create_directory(dive);
  options_.calib = calib_;
  options_.files.left_pattern = (folder_.path() / "left/*.pgm").string();
  options_.files.right_pattern = (folder_.path() / "right/*.pgm").string();
  const MissionInput input = openMission(dive, options_);
  EXPECT_EQ(input.files->pairs.at(0).right, "right/1.pgm");
  EXPECT_EQ(input.paths.images(), folder_.path());
}

// 64 x 48 samples of 16 bits.
std::string deepImage(int sample) {
  std::string pixels;
  for (int k = 0; k < 64 * 48; ++k) pixels += {static_cast<char>(sample >> 8), static_cast<char>(sample)};
  return "P5 64 48 65535\n" + pixels;
}

TEST_F(FoundCalibration, ImagesBrighterThanThoseThatTellTheBitsAreCutAndNotRefused) {
  constexpr int kPairs = 65;  // every second one is looked at
  for (int k = 0; k < kPairs; ++k)
    for (const char* side : {"left/", "right/"})
      test::writeText(folder_.path() / (side + std::to_string(k + 1) + ".pgm"),
                      deepImage(k == 3 ? 3000 : 1000));
  test::writeText(calib_, replaced(replaced(kCalibration, "[71, 0, 30]", "[70, 0, 31]"), "71, 22", "70, 23"));
  const MissionInput input = open();
  EXPECT_EQ(input.mission.cameras.bits, 11) << "10 would be full scale at once";
  EXPECT_THAT(input.assumed,
              Contains(HasSubstr("of 11 bits, as some of them tell; brighter samples are cut")));
  const auto brightest = [&](const char* name) { return brightestOf(input.image({0, name, ""}, 0).view); };
  EXPECT_EQ(brightest("left/1.pgm"), 1000);
  EXPECT_EQ(brightest("left/4.pgm"), 2047);
  test::writeText(folder_.path() / "left/1.pgm", deepImage(4095));  // a converter's full scale
  EXPECT_EQ(open().mission.cameras.bits, 12);
}

TEST_F(FoundCalibration, HasFlatPortsBesideIt) {
  const Digest key = rigKey();
  test::writeText(calib_.string() + ".ports", "0 0 1 0.03 0.01 1.49 1.339\n0 0 1 0.02 0.01 1.49 1.339\n");
  const MissionInput input = open();
  ASSERT_TRUE(input.rig.left.port && input.rig.right.port);
  EXPECT_EQ(input.rig.left.port->air.fx, 70);
  EXPECT_NEAR(input.rig.left.fx, 94, 2);
  EXPECT_THAT(input.assumed, Contains(HasSubstr("flat ports: ")));
  EXPECT_NE(rigKey(), key);
  test::writeText(calib_.string() + ".ports", "0 0 1 0.03\n");
  EXPECT_THAT(refusal(), HasSubstr("rig.json.ports"));
}

// 64 x 48, by the places in squares of 2 x 2.
std::string mosaicImage(const std::string& square) {
  std::string pixels;
  for (std::size_t k = 0; k < 64 * 48; ++k) pixels += square[k / 64 % 2 * 2 + k % 2];
  return "P5 64 48 255\n" + pixels;
}

TEST_F(FoundCalibration, AMosaicThatNobodyNamedIsRefusedWithItsLikeliestOrder) {
  const std::pair<const char*, const char*> cases[] = {
      {"addn", "bayer-rggb"}, {"ndda", "bayer-bggr"}, {"dand", "bayer-grbg"}, {"dnad", "bayer-gbrg"}};
  for (const auto& [square, order] : cases) {
    test::writeText(folder_.path() / "left/1.pgm", mosaicImage(square));
    EXPECT_THAT(refusal(), HasSubstr(std::string("give --left-format ") + order)) << square;
    options_.left_format = order;
    EXPECT_EQ(refusal(), "");
    options_.left_format = "auto";
  }
  for (const char* square : {"dddd", "aadd", "adad"}) {  // even; rows and columns of an interlaced chip
    test::writeText(folder_.path() / "left/1.pgm", mosaicImage(square));
    EXPECT_EQ(refusal(), "") << square;
  }
  options_.left_format = "mono";
  test::writeText(folder_.path() / "left/1.pgm", mosaicImage("addn"));
  EXPECT_EQ(refusal(), "");
}

TEST_F(FoundCalibration, IsInTheKeysOfResults) {
  const Digest key = rigKey();
  EXPECT_EQ(rigKey(), key);
  test::writeText(calib_, replaced(kCalibration, "0.1", "0.2"));
  EXPECT_NE(rigKey(), key);
  test::writeText(calib_, kCalibration);
  options_.calib_unit = 0.01;
  EXPECT_NE(rigKey(), key);
}

}  // namespace
}  // namespace fathom::topside

#include <gmock/gmock.h>
#include "recon/topside/commands/commands.hpp"

#include <Eigen/Dense>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "realtime/base/input_error.hpp"
#include "recon/calibration/colour_chart.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/topside/calibration/chart_images.hpp"
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

namespace fathom::calibration {
namespace {

// Crosstalk of a camera with overlapping filters; rows add up to 1.
Eigen::Matrix3d crosstalk() {
  Eigen::Matrix3d out;
  out << 0.72, 0.22, 0.06, 0.10, 0.78, 0.12, 0.03, 0.20, 0.77;
  return out;
}

// A chart on black in sea water that takes most of the red, lit from the left, in perspective.
cv::Mat sceneOfChart(double exposure) {
  constexpr int kEdge = 60, kGap = 6, kMargin = 40;  // [px]
  const int width = 6 * (kEdge + kGap) + kGap + 2 * kMargin, height = 4 * (kEdge + kGap) + kGap + 2 * kMargin;
  cv::Mat chart(height, width, CV_32FC3, cv::Scalar::all(0.25));
  chart(cv::Rect(kMargin, kMargin, width - 2 * kMargin, height - 2 * kMargin)).setTo(cv::Scalar::all(0.01));
  for (int k = 0; k < kPatches; ++k) {
    const cv::Rect at(kMargin + kGap + k % 6 * (kEdge + kGap), kMargin + kGap + k / 6 * (kEdge + kGap), kEdge,
                      kEdge);
    const Eigen::Vector3d seen = crosstalk() * patchColour(k);
    chart(at).setTo(cv::Scalar(seen(0), seen(1), seen(2)));
  }
  const std::vector<cv::Point2f> from{{0, 0},
                                      {static_cast<float>(width), 0},
                                      {static_cast<float>(width), static_cast<float>(height)},
                                      {0, static_cast<float>(height)}},
      to{{60, 40}, {590, 70}, {600, 460}, {45, 430}};
  cv::Mat scene(512, 640, CV_32FC3, cv::Scalar::all(0.25));
  cv::warpPerspective(chart, scene, cv::getPerspectiveTransform(from, to), scene.size(), cv::INTER_AREA,
                      cv::BORDER_TRANSPARENT);
  const double water[] = {0.35, 0.9, 0.8};
  for (int y = 0; y < scene.rows; ++y)
    for (int x = 0; x < scene.cols; ++x)
      for (int c = 0; c < 3; ++c)
        scene.at<cv::Vec3f>(y, x)[c] *=
            static_cast<float>(exposure * std::exp(-0.3 * x / scene.cols) * water[c]);
  return scene;
}

// Samples of 12 bits in the upper part of 16, with noise.
class Sensor {
 public:
  explicit Sensor(unsigned seed) : random_(seed) {}
  std::uint16_t sample(float light) {
    const double with_noise = std::round(4095 * (static_cast<double>(light) + noise_(random_)));
    return cv::saturate_cast<std::uint16_t>(std::clamp(with_noise, 0.0, 4095.0) * 16);
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> noise_{0, 0.003};
};
cv::Mat photograph(double exposure, unsigned seed) {
  const cv::Mat scene = sceneOfChart(exposure);
  Sensor sensor(seed);
  cv::Mat raw(scene.size(), CV_16UC1);
  for (int y = 0; y < raw.rows; ++y)
    for (int x = 0; x < raw.cols; ++x)
      raw.at<std::uint16_t>(y, x) = sensor.sample(scene.at<cv::Vec3f>(y, x)[x % 2 + y % 2]);
  return raw;
}
cv::Mat rgbOf(const cv::Mat& scene) {  // blue first, as OpenCV writes it
  Sensor sensor(4);
  cv::Mat out(scene.size(), CV_16UC3);
  for (int y = 0; y < out.rows; ++y)
    for (int x = 0; x < out.cols; ++x)
      for (int c = 0; c < 3; ++c)
        out.at<cv::Vec3w>(y, x)[2 - c] = sensor.sample(scene.at<cv::Vec3f>(y, x)[c]);
  return out;
}

class ColourChart : public ::testing::Test {
 protected:
  std::filesystem::path save(const cv::Mat& image, const char* name) {
    const std::filesystem::path file = folder_.path() / name;
    cv::imwrite(file.string(), image);
    return file;
  }
  test::TemporaryFolder folder_;
};

TEST_F(ColourChart, AMatrixIsFoundFromChartsThatAreFoundByThemselvesOrByTheirCorners) {
  const auto one = save(photograph(0.9, 1), "one.tif"), other = save(photograph(0.6, 2), "other.tif");
  const topside::Samples rggb = topside::samplesNamed("bayer-rggb");
  std::vector<ChartView> found{topside::readCharts(one, rggb, {}).at(0),
                               topside::readCharts(other, rggb, {}).at(0)};
  // Where photograph() puts the outer corners of the four patches.
  const cv::Mat place =
      cv::getPerspectiveTransform(std::vector<cv::Point2f>{{0, 0}, {482, 0}, {482, 350}, {0, 350}},
                                  std::vector<cv::Point2f>{{60, 40}, {590, 70}, {600, 460}, {45, 430}});
  std::vector<cv::Point2d> corners;
  cv::perspectiveTransform(std::vector<cv::Point2d>{{46, 46}, {436, 46}, {436, 304}, {46, 304}}, corners,
                           place);
  topside::ChartCorners given;
  for (std::size_t k = 0; k < 4; ++k) given[k] = {corners[k].x, corners[k].y};
  for (const auto& views : {found, std::vector{topside::readCharts(one, rggb, given).at(0)}}) {
    const ColourCalibration done = calibrateColours(views, "test");
    const double off = (done.matrix * crosstalk() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    std::printf("matrix off by %.4f; CIEDE2000 %.2f, with it %.2f, worst %.2f\n", off, done.median_before,
                done.median_after, done.worst_after);
    EXPECT_LT(off, 0.0045);
    EXPECT_LT(done.median_after, 0.18);
    EXPECT_GT(done.median_before, 4);
    EXPECT_LT((done.matrix.rowwise().sum() - Eigen::Vector3d::Ones()).norm(), 1e-9);
  }
}

TEST_F(ColourChart, ChartsAreFoundInEveryOrientationAndSeveralInOneImage) {
  const cv::Mat upright = sceneOfChart(0.9);
  const ChartView wanted =
      topside::readCharts(save(rgbOf(upright), "upright.tif"), topside::Samples::kRgb, {}).at(0);
  cv::Mat turned, both;
  for (const int turn : {cv::ROTATE_90_CLOCKWISE, cv::ROTATE_180, cv::ROTATE_90_COUNTERCLOCKWISE}) {
    cv::rotate(upright, turned, turn);
    const auto found = topside::readCharts(save(rgbOf(turned), "turned.tif"), topside::Samples::kRgb, {});
    ASSERT_EQ(found.size(), 1u) << turn;
    for (std::size_t k = 0; k < kPatches; ++k)
      EXPECT_LT((*found[0].patches[k] - *wanted.patches[k]).norm(), 0.006) << turn << " " << k;
  }
  cv::rotate(sceneOfChart(0.7), turned, cv::ROTATE_180);
  cv::hconcat(upright, turned, both);
  const auto found = topside::readCharts(save(rgbOf(both), "both.tif"), topside::Samples::kRgb, {});
  ASSERT_EQ(found.size(), 2u);
  EXPECT_THAT(found[1].name, testing::EndsWith("both.tif, chart 2"));
  EXPECT_LT((calibrateColours(found, "test").matrix * crosstalk() - Eigen::Matrix3d::Identity()).norm(),
            0.007);
}

TEST_F(ColourChart, WhatIsNoChartAtTheCornersAndAMatrixThatMakesColoursWorseAreRefused) {
  const auto file = save(photograph(0.9, 1), "one.tif");
  const topside::ChartCorners beside = {{{60, 40}, {300, 40}, {300, 200}, {60, 200}}};
  EXPECT_THAT(
      test::refusal([&] { (void)topside::readCharts(file, topside::samplesNamed("bayer-rggb"), beside); }),
      testing::HasSubstr("--corners"));
  ChartView mixed = topside::readCharts(file, topside::samplesNamed("bayer-rggb"), {}).at(0);
  std::mt19937 random(3);
  std::shuffle(mixed.patches.begin(), mixed.patches.end(), random);
  EXPECT_LT(agreementOf(mixed).value(), kAgrees);
  EXPECT_THAT(test::refusal([&] { (void)calibrateColours({mixed}, "test"); }),
              testing::HasSubstr("nothing is written"));
}

TEST_F(ColourChart, OfRealPhotographsInAirAndWaterEachGivesABetterMatrixOrIsRefusedWithTheReason) {
  FATHOM_REQUIRE_DATA("colour/calib_1_above.png");
  struct Photograph {
    const char* name;
    std::size_t charts;
    // Median CIEDE2000 of patches that the fit did not know, at most twice what was measured; 0: refused.
    double most;
    const char* reason;
  };
  for (const Photograph& p :
       std::vector<Photograph>{{"calib_1_above.png", 1, 10.6, ""},
                               {"calib_2_above.jpg", 2, 0, "the camera needs none"},
                               {"ColorChart_325_110_led.bmp.xz", 1, 12, ""},
                               {"ColorChart_325_110_natural.bmp.xz", 1, 0, "nothing is written"},
                               {"ColorChart_325_60_led.bmp.xz", 1, 0, "nothing is written"},
                               {"calib_1_under.png", 1, 0, "nothing is written"},
                               {"calib_2_under.jpg", 2, 0, "nothing is written"}}) {
    std::filesystem::path file = test::dataFile(std::string("colour/") + p.name);
    if (file.extension() == ".xz") {
      const std::filesystem::path unpacked = folder_.path() / file.stem();
      ASSERT_EQ(std::system(("xz -dc '" + file.string() + "' > '" + unpacked.string() + "'").c_str()), 0);
      file = unpacked;
    }
    ColourCalibration done;
    std::size_t charts = 0;
    const std::string refused = test::refusal([&] {
      const auto views = topside::readCharts(file, topside::Samples::kAuto, {});
      charts = views.size();
      done = calibrateColours(views, file.string());
    });
    std::printf("%s: %zu charts, %.1f, with the matrix %.1f; of patches left out %.1f, %.1f %s\n", p.name,
                charts, done.median_before, done.median_after, done.held_before, done.held_after,
                refused.c_str());
    EXPECT_EQ(charts, p.charts) << p.name;
    if (p.most == 0) {
      EXPECT_THAT(refused, testing::HasSubstr(p.reason)) << p.name;
    } else {
      EXPECT_EQ(refused, "") << p.name;
      EXPECT_LT(done.held_after, p.most) << p.name;
      EXPECT_LE(done.held_after, done.held_before) << p.name;
    }
  }
}

TEST_F(ColourChart, ClippedPatchesAreLeftOutAndTooManyAreRefused) {
  const topside::Samples rggb = topside::samplesNamed("bayer-rggb");
  const ChartView bright = topside::readCharts(save(photograph(1.35, 3), "bright.tif"), rggb, {}).at(0);
  EXPECT_FALSE(bright.patches[18].has_value());  // white
  EXPECT_TRUE(bright.patches[23].has_value());
  const Eigen::Matrix3d left = calibrateColours({bright}, "test").matrix * crosstalk();
  std::printf("off by %.4f\n", (left - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff());
  EXPECT_LT((left - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 0.0024);
  ChartView few = bright;
  for (std::size_t k = 0; k < 15; ++k) few.patches[k].reset();
  EXPECT_THROW((void)calibrateColours({few}, "test"), InputError);
  EXPECT_THROW(
      (void)topside::readCharts(save(cv::Mat(480, 640, CV_16UC1, cv::Scalar(9000)), "bare.tif"), rggb, {}),
      InputError);
}

TEST_F(ColourChart, AMatrixBesideACalibrationTurnsColoursAndNoGrey) {
  const std::filesystem::path calib = folder_.path() / "stereo.calib";
  EXPECT_FALSE(readColours(calib).has_value());
  writeColours(coloursBeside(calib), crosstalk().inverse());
  const Eigen::Matrix3d matrix = readColours(calib).value();
  EXPECT_LT((matrix - crosstalk().inverse()).norm(), 1e-6);
  std::vector<std::uint8_t> image = {90, 90, 90, 150, 90, 60, 255, 255, 255};
  ColourMatrix(matrix).apply(image);
  EXPECT_NEAR(image[0], 90, 1);
  EXPECT_NEAR(image[2], 90, 1);
  EXPECT_EQ(image[7], 255);
  const Eigen::Vector3d expected =
      matrix *
      Eigen::Vector3d(linearFromSrgb(150 / 255.0), linearFromSrgb(90 / 255.0), linearFromSrgb(60 / 255.0));
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(linearFromSrgb(image[3 + c] / 255.0), std::max(expected(c), 0.0), 0.004);
  std::ofstream(coloursBeside(calib)) << "1 0 0 0 1 0 0 0 2";
  EXPECT_THROW((void)readColours(calib), InputError);
  std::ofstream(coloursBeside(calib)) << "1 0 0";
  EXPECT_THROW((void)readColours(calib), InputError);
}

}  // namespace
}  // namespace fathom::calibration

#include "recon/calibration/colour_chart.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/topside/calibration/chart_images.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::calibration {
namespace {

// Crosstalk of a camera with overlapping filters; rows add up to 1.
Eigen::Matrix3d crosstalk() {
  Eigen::Matrix3d out;
  out << 0.72, 0.22, 0.06, 0.10, 0.78, 0.12, 0.03, 0.20, 0.77;
  return out;
}

// A chart on black in sea water that takes most of the red, lit from the left, in perspective: 12-bit RGGB.
cv::Mat photograph(double exposure, unsigned seed) {
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
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 0.003);
  const double water[] = {0.35, 0.9, 0.8};
  cv::Mat raw(scene.size(), CV_16UC1);
  for (int y = 0; y < raw.rows; ++y)
    for (int x = 0; x < raw.cols; ++x) {
      const int c = x % 2 + y % 2;
      const double light = exposure * std::exp(-0.3 * x / raw.cols) * water[c] *
                               static_cast<double>(scene.at<cv::Vec3f>(y, x)[c]) +
                           noise(random);
      raw.at<std::uint16_t>(y, x) =
          cv::saturate_cast<std::uint16_t>(std::clamp(std::round(4095 * light), 0.0, 4095.0) * 16);
    }
  return raw;
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
  std::vector<ChartView> found{topside::readChart(one, rggb, {}), topside::readChart(other, rggb, {})};
  // Where photograph() puts the outer corners of the four patches.
  const cv::Mat place =
      cv::getPerspectiveTransform(std::vector<cv::Point2f>{{0, 0}, {482, 0}, {482, 350}, {0, 350}},
                                  std::vector<cv::Point2f>{{60, 40}, {590, 70}, {600, 460}, {45, 430}});
  std::vector<cv::Point2d> corners;
  cv::perspectiveTransform(std::vector<cv::Point2d>{{46, 46}, {436, 46}, {436, 304}, {46, 304}}, corners,
                           place);
  topside::ChartCorners given;
  for (std::size_t k = 0; k < 4; ++k) given[k] = {corners[k].x, corners[k].y};
  for (const auto& views : {found, std::vector{topside::readChart(one, rggb, given)}}) {
    const ColourCalibration done = calibrateColours(views, "test");
    const double off = (done.matrix * crosstalk() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    std::printf("matrix off by %.4f; CIEDE2000 %.2f, with it %.2f, worst %.2f\n", off, done.median_before,
                done.median_after, done.worst_after);
    EXPECT_LT(off, 0.0024);
    EXPECT_LT(done.median_after, 0.18);
    EXPECT_GT(done.median_before, 4);
    EXPECT_LT((done.matrix.rowwise().sum() - Eigen::Vector3d::Ones()).norm(), 1e-9);
  }
}

TEST_F(ColourChart, ClippedPatchesAreLeftOutAndTooManyAreRefused) {
  const topside::Samples rggb = topside::samplesNamed("bayer-rggb");
  const ChartView bright = topside::readChart(save(photograph(1.35, 3), "bright.tif"), rggb, {});
  EXPECT_FALSE(bright.patches[18].has_value());  // white
  EXPECT_TRUE(bright.patches[23].has_value());
  const Eigen::Matrix3d left = calibrateColours({bright}, "test").matrix * crosstalk();
  std::printf("off by %.4f\n", (left - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff());
  EXPECT_LT((left - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 0.0024);
  ChartView few = bright;
  for (std::size_t k = 0; k < 15; ++k) few.patches[k].reset();
  EXPECT_THROW((void)calibrateColours({few}, "test"), InputError);
  EXPECT_THROW(
      (void)topside::readChart(save(cv::Mat(480, 640, CV_16UC1, cv::Scalar(9000)), "bare.tif"), rggb, {}),
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

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/stereo/npz.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::stereo {
namespace {

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

// Middlebury 2014 Motorcycle, quarter size (Scharstein et al.): a rectified pair, left(x) matches right(x -
// d), and Z = f B / (d + doffs), so that the right camera's centre lies doffs to the right of the left's.
TEST(Middlebury, MotorcycleDisparitiesAgreeWithTheTruth) {
  FATHOM_REQUIRE_DATA("stereo/motorcycle_left.png");
  constexpr double kFocal = 994.978, kCx = 311.193, kCy = 254.877, kDoffs = 31.086;  // [px]
  constexpr double kBaseline = 0.193001;                                             // [m]
  const cv::Mat left = cv::imread(test::dataFile("stereo/motorcycle_left.png"), cv::IMREAD_GRAYSCALE);
  const cv::Mat right = cv::imread(test::dataFile("stereo/motorcycle_right.png"), cv::IMREAD_GRAYSCALE);
  const test::FloatArray truth = test::readNpz(test::dataFile("stereo/motorcycle_disp.npz"));
  ASSERT_EQ(truth.rows, left.rows);
  ASSERT_EQ(truth.columns, left.cols);

  StereoRig rig;
  rig.left = {left.cols, left.rows, kFocal, kFocal, kCx, kCy};
  rig.right = rig.left;
  rig.right.cx += kDoffs;
  rig.T_right_left = SE3(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), {-kBaseline, 0, 0});
  SparseStereoConfig config;
  config.max_features = 5000;  // all else as on the seafloor
  SparseStereo stereo(rig, config);
  // A workshop, not a seafloor: all that is known is that most of it lies about three metres away.
  const StereoResult& result = stereo.process(viewOf(left), viewOf(right), {Eigen::Vector3d::UnitZ(), 2.9});

  std::vector<double> errors;
  for (const StereoPoint& p : result.points) {
    const double d = static_cast<double>(
        truth.at(static_cast<int>(std::lround(p.left.y())), static_cast<int>(std::lround(p.left.x()))));
    if (std::isfinite(d)) errors.push_back(std::abs(static_cast<double>(p.left.x() - p.right.x()) - d));
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GE(errors.size(), 2000U);
  const double median = errors[errors.size() / 2];
  const double bad =
      static_cast<double>(std::count_if(errors.begin(), errors.end(), [](double e) { return e > 1; })) /
      static_cast<double>(errors.size());
  std::printf("%zu points with truth, median %.3f px, beyond 1 px %.2f %%\n", errors.size(), median,
              100 * bad);
  EXPECT_LE(median, 0.15);
  EXPECT_LE(bad, 0.03);
}

}  // namespace
}  // namespace fathom::stereo

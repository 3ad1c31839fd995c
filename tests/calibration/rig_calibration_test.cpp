#include "recon/calibration/rig_calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "tests/calibration/synthetic_boards.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::calibration {
namespace {

using testing::HasSubstr;

using test::kBoard;
const ImageSize kSize{680, 512};

RigCalibration calibrated(const std::vector<BoardView>& views) {
  return calibrateRig(views, kBoard, kSize, kSize, {}, "boards");
}

TEST(RigCalibration, RecoversTheRigFromExactCorners) {
  const StereoRig truth = test::syntheticRig();
  const RigCalibration done = calibrated(test::syntheticViews(truth, kBoard, 14, 0.0, 1));
  EXPECT_LT(done.stereo_rms, 1e-3);
  EXPECT_NEAR(done.rig.baseline(), truth.baseline(), 2e-6);
  EXPECT_NEAR(done.rig.left.fx, truth.left.fx, 0.02);
  EXPECT_NEAR(done.rig.right.cy, truth.right.cy, 0.02);
  EXPECT_NEAR(done.rig.left.k1, truth.left.k1, 1e-3);
  EXPECT_EQ(done.rig.left.k3, 0.0);
  EXPECT_TRUE(done.dropped.empty());
}

TEST(RigCalibration, ErrorsAreAsLargeAsItsStandardDeviationsSay) {
  const StereoRig truth = test::syntheticRig();
  double baseline = 0, focal = 0;
  constexpr unsigned kRuns = 16;
  for (unsigned run = 0; run < kRuns; ++run) {
    const RigCalibration done = calibrated(test::syntheticViews(truth, kBoard, 12, 0.1, 200 + run));
    baseline += std::pow((done.rig.baseline() - truth.baseline()) / done.sigma.baseline, 2) / kRuns;
    focal += std::pow((done.rig.left.fx - truth.left.fx) / done.sigma.left.fx, 2) / kRuns;
  }
  // The root mean square of 16 draws is good to 18 %.
  EXPECT_NEAR(std::sqrt(baseline), 1.0, 0.4);
  EXPECT_NEAR(std::sqrt(focal), 1.0, 0.4);
}

TEST(RigCalibration, RmsIsThatOfTheDistanceBetweenMeasuredAndProjected) {
  constexpr double kNoise = 0.2;  // of each coordinate [px]
  const RigCalibration done = calibrated(test::syntheticViews(test::syntheticRig(), kBoard, 20, kNoise, 3));
  EXPECT_NEAR(done.stereo_rms, kNoise * std::sqrt(2.0), 0.02);
}

TEST(RigCalibration, AViewWithAGrossErrorIsDroppedByNameWithItsReason) {
  auto views = test::syntheticViews(test::syntheticRig(), kBoard, 12, 0.05, 4);
  views[3].left[17] += Eigen::Vector2d(25, -14);
  const RigCalibration done = calibrated(views);
  ASSERT_EQ(done.dropped.size(), 1u);
  EXPECT_EQ(done.dropped[0].name, "view4");
  EXPECT_THAT(done.dropped[0].reason, HasSubstr("left RMS"));
  EXPECT_EQ(done.views.size(), 11u);
  EXPECT_NEAR(done.rig.baseline(), test::syntheticRig().baseline(), 3e-4);
}

TEST(RigCalibration, ImagesOfDifferentMomentsAreDropped) {
  auto views = test::syntheticViews(test::syntheticRig(), kBoard, 12, 0.05, 5);
  std::swap(views[2].right, views[7].right);
  const RigCalibration done = calibrated(views);
  ASSERT_EQ(done.dropped.size(), 2u);
  EXPECT_THAT(done.dropped[0].reason, HasSubstr("not taken at the same moment"));
  EXPECT_EQ(done.views.size(), 10u);
}

TEST(RigCalibration, CornersCountedFromTheOtherEndAreTurnedRound) {
  auto views = test::syntheticViews(test::syntheticRig(), kBoard, 12, 0.05, 6);
  const RigCalibration straight = calibrated(views);
  for (const std::size_t v : {1u, 4u, 5u, 9u}) std::reverse(views[v].right.begin(), views[v].right.end());
  const RigCalibration turned = calibrated(views);
  EXPECT_TRUE(turned.dropped.empty());
  EXPECT_NEAR(turned.stereo_rms, straight.stereo_rms, 1e-6);
  EXPECT_NEAR(turned.rig.baseline(), straight.rig.baseline(), 1e-7);
}

TEST(RigCalibration, TooFewViewsAreRefusedWithTheirNumber) {
  const auto views = test::syntheticViews(test::syntheticRig(), kBoard, 3, 0.05, 7);
  EXPECT_THAT(test::refusal([&] { (void)calibrated(views); }), HasSubstr("3 usable pairs"));
}

TEST(RigCalibration, ViewsThatAreAllAlikeAreRefused) {
  auto views = test::syntheticViews(test::syntheticRig(), kBoard, 1, 0.0, 8);
  const std::vector<Eigen::Vector3d> points = boardPoints(kBoard);
  const StereoRig rig = test::syntheticRig();
  for (std::size_t k = 0; k < points.size(); ++k) {  // square to the camera
    const Eigen::Vector3d p = points[k] + Eigen::Vector3d(-0.3, -0.2, 2.0);
    views[0].left[k] = rig.left.project(p);
    views[0].right[k] = rig.right.project(rig.T_right_left * p);
  }
  views.resize(6, views[0]);
  EXPECT_THROW((void)calibrated(views), InputError);
}

}  // namespace
}  // namespace fathom::calibration

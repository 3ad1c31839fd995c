#include "recon/calibration/board_check.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/calibration/synthetic_boards.hpp"

namespace fathom::calibration {
namespace {

using test::kBoard;

TEST(BoardCheck, ExactCornersOfTheTrueRigHaveNoError) {
  const StereoRig rig = test::syntheticRig();
  const BoardCheck check = checkBoards(rig, kBoard, test::syntheticViews(rig, kBoard, 5, 0.0, 1));
  ASSERT_EQ(check.boards.size(), 5u);
  EXPECT_LT(check.max_z, 1e-6);
  EXPECT_NEAR(check.scale, 1.0, 1e-6);
}

TEST(BoardCheck, DepthErrorIsThatOfTheRigsTheory) {
  const StereoRig rig = test::syntheticRig();
  constexpr double kNoise = 0.1;  // [px]
  const BoardCheck check = checkBoards(rig, kBoard, test::syntheticViews(rig, kBoard, 40, kNoise, 2));
  // sigma_z = z^2 sigma_d / (f b), the disparity's noise being that of both images; the board's own six
  // parameters take a few per cent of it away.
  double z4 = 0;
  for (const BoardError& b : check.boards)
    z4 += std::pow(b.range, 4) / static_cast<double>(check.boards.size());
  const double expected = std::sqrt(z4) * kNoise * std::sqrt(2.0) / (rig.left.fx * rig.baseline());
  EXPECT_NEAR(std::sqrt(check.covariance(2, 2)) / expected, 1.0, 0.15);
  EXPECT_LT(check.covariance(0, 0), 0.1 * check.covariance(2, 2));
}

TEST(BoardCheck, ABaselineTooLongShowsInTheScale) {
  const StereoRig rig = test::syntheticRig();
  const auto views = test::syntheticViews(rig, kBoard, 5, 0.0, 3);
  StereoRig longer = rig;
  longer.T_right_left = SE3(rig.T_right_left.rotation(), 1.02 * rig.T_right_left.translation());
  EXPECT_NEAR(checkBoards(longer, kBoard, views).scale, 1.02, 1e-6);
}

TEST(BoardCheck, AViewThatDoesNotTriangulateIsNamed) {
  const StereoRig rig = test::syntheticRig();
  auto views = test::syntheticViews(rig, kBoard, 2, 0.0, 4);
  for (auto& corner : views[1].right) corner.x() += 300;  // rays that meet behind the cameras
  const BoardCheck check = checkBoards(rig, kBoard, views);
  EXPECT_EQ(check.boards.size(), 1u);
  ASSERT_EQ(check.failed.size(), 1u);
  EXPECT_EQ(check.failed[0], "view2");
}

TEST(BoardCheck, NoViewsGiveAnEmptyCheck) {
  const BoardCheck check = checkBoards(test::syntheticRig(), kBoard, {});
  EXPECT_TRUE(check.boards.empty());
  EXPECT_EQ(check.max_z, 0.0);
}

}  // namespace
}  // namespace fathom::calibration

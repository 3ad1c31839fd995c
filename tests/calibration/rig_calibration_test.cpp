#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "realtime/base/input_error.hpp"
#include "recon/calibration/chessboard.hpp"
#include "recon/calibration/rig_calibration.hpp"
#include "recon/calibration/self_calibration.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/rigs.hpp"

namespace fathom::calibration {
namespace {

using test::kBoard, testing::HasSubstr;

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

constexpr double kBaseline = 0.3, kNoise = 0.3;  // [m]; of a coordinate [px]

StereoRig trueRig() {
  StereoRig rig{.left = {1360, 1024, 1730, 1737, 668, 519, 0.15, 0.3, -0.003, 0.002, 0},
                .right = {1280, 960, 1550, 1552, 651, 470, 0.12, 0.4, 0.001, -0.002, 0},
                .T_right_left = SE3::fromEuler(0.02, -0.03, 0.05, {-0.29, 0.03, 0})};
  const Eigen::Vector3d t = rig.T_right_left.translation().normalized() * kBaseline;
  rig.T_right_left = SE3(rig.T_right_left.rotation(), t);
  return rig;
}

struct Track {
  double relief = 0.25;  // standard deviation of heights [m]
  double tilt = 0.5;     // of the camera from straight down [rad]
  double sway = 0.15;    // of its attitude from pair to pair [rad]
};

// A camera 2 m above rough ground; every twentieth sighting is an outlier.
RigTracks syntheticTracks(const StereoRig& rig, const Track& path) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> even(0, 1);
  constexpr std::uint32_t kPairs = 12;
  RigTracks out;
  out.left = {rig.left.width, rig.left.height};
  out.right = {rig.right.width, rig.right.height};
  std::vector<SE3> T_cam_world;
  for (std::uint32_t k = 0; k < kPairs; ++k) {
    out.names.push_back("pair" + std::to_string(k));
    const SE3 T_world_cam = SE3::fromEuler(path.tilt + path.sway * normal(random), path.sway * normal(random),
                                           path.sway * normal(random), {0.25 * k, 0.02 * normal(random), 0});
    T_cam_world.push_back(T_world_cam.inverse());
  }
  constexpr int kPoints = 2500;
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector3d point(-2 + 7 * even(random), -4 + 6 * even(random),
                                2 + path.relief * normal(random));
    RigTrack track;
    for (std::uint32_t k = 0; k < kPairs; ++k)
      for (const bool right : {false, true}) {
        Eigen::Vector3d p = T_cam_world[k] * point;
        if (right) p = rig.T_right_left * p;
        const Camera& camera = right ? rig.right : rig.left;
        if (p.z() < 0.2 || p.head<2>().norm() > 0.7 * p.z()) continue;
        Eigen::Vector2d pixel = camera.project(p);
        if (!camera.contains(pixel)) continue;
        pixel += kNoise * Eigen::Vector2d(normal(random), normal(random));
        if (even(random) < 0.05) pixel = {camera.width * even(random), camera.height * even(random)};
        track.sightings.push_back({k, right, pixel});
      }
    if (track.sightings.size() > 1) out.tracks.push_back(track);
  }
  return out;
}

TEST(SelfCalibration, ARigIsFoundFromItsTracks) {
  const StereoRig truth = trueRig();
  SelfCalibrationConfig config;
  config.bundle.prior.centre = kFreeCentre;  // these are off the middle
  const RigCalibration found = selfCalibrate(syntheticTracks(truth, {}), kBaseline, config, "synthetic");
  EXPECT_EQ(found.views.size(), 12u);
  EXPECT_NEAR(found.rig.baseline(), kBaseline, 1e-9);
  const Vector6d turn = (found.rig.T_right_left * truth.T_right_left.inverse()).log();
  std::printf(
      "focal left %.4f %%, right %.4f %%; turn %.4f deg; rms %.3f px; sigma f %.2f px, turn %.4f deg\n",
      100 * (found.rig.left.fx / truth.left.fx - 1), 100 * (found.rig.right.fx / truth.right.fx - 1),
      57.3 * turn.tail<3>().norm(), found.stereo_rms, found.sigma.left.fx,
      57.3 * found.sigma.rotation.norm());
  constexpr double kSigmas = 3.5;
  EXPECT_NEAR(found.rig.left.fx, truth.left.fx, kSigmas * found.sigma.left.fx);
  EXPECT_NEAR(found.rig.left.fy, truth.left.fy, kSigmas * found.sigma.left.fy);
  EXPECT_NEAR(found.rig.left.cx, truth.left.cx, kSigmas * found.sigma.left.cx);
  EXPECT_NEAR(found.rig.left.k1, truth.left.k1, kSigmas * found.sigma.left.k1);
  EXPECT_NEAR(found.rig.right.fx, truth.right.fx, kSigmas * found.sigma.right.fx);
  EXPECT_NEAR(found.rig.right.cy, truth.right.cy, kSigmas * found.sigma.right.cy);
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(std::abs(turn(3 + i)), kSigmas * found.sigma.rotation(i));
    EXPECT_NEAR(found.rig.T_right_left.translation()(i), truth.T_right_left.translation()(i),
                kSigmas * found.sigma.translation(i));
  }
  EXPECT_LT(found.sigma.left.fx, 0.002 * truth.left.fx);
  EXPECT_NEAR(found.stereo_rms, std::sqrt(2) * kNoise, 0.1);
}

TEST(SelfCalibration, LevelGroundFromStraightAboveDoesNotDetermineAFocalLength) {
  EXPECT_THAT(test::refusal([] {
                (void)selfCalibrate(syntheticTracks(trueRig(), {.relief = 0, .tilt = 0, .sway = 0}),
                                    kBaseline, {}, "level");
              }),
              testing::HasSubstr("level: the images do not determine the rig"));
}

TEST(SelfCalibration, PairsWithoutCommonPlacesAreRefused) {
  RigTracks tracks = syntheticTracks(trueRig(), {});
  for (RigTrack& track : tracks.tracks) track.sightings.resize(1);
  EXPECT_THAT(test::refusal([&] { (void)selfCalibrate(tracks, kBaseline, {}, "alone"); }),
              testing::HasSubstr("alone: left and right show only 0 places in common"));
}

}  // namespace
}  // namespace fathom::calibration

#include "recon/calibration/self_calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/text_files.hpp"

namespace fathom::calibration {
namespace {

constexpr double kBaseline = 0.3, kNoise = 0.3;  // [m]; of a coordinate [px]

StereoRig trueRig() {
  StereoRig rig;
  rig.left = {1360, 1024, 1730, 1737, 668, 519, 0.15, 0.3, -0.003, 0.002, 0};
  rig.right = {1280, 960, 1550, 1552, 651, 470, 0.12, 0.4, 0.001, -0.002, 0};
  rig.T_right_left = SE3::fromEuler(0.02, -0.03, 0.05, {-0.29, 0.03, 0});
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

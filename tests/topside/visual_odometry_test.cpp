#include "recon/topside/localise/visual_odometry.hpp"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "tests/topside/tiny_mission.hpp"

namespace fathom::topside {
namespace {

constexpr double kFrameStep = 0.25, kCameraAltitude = 2.0;  // [m]

// Pairs over level ground whose points all look different.
struct SeenGround final : FeatureStore {
  static constexpr std::size_t kBytes = 128;
  struct Point {
    Eigen::Vector3d place;  // in nav [m]
    std::array<std::uint8_t, kBytes> looks{};
  };
  std::vector<closure::FrameFeatures> seen;
  StereoRig rig = test::TinyMission::rig();
  std::mt19937 random{7};

  [[nodiscard]] std::vector<Point> points(std::size_t count) {
    std::uniform_real_distribution<double> metres(-2, 3);
    std::vector<Point> some(count);
    for (Point& p : some) {
      p.place = {metres(random), metres(random), 10 + kCameraAltitude};
      for (std::uint8_t& byte : p.looks) byte = static_cast<std::uint8_t>(random() & 0x7F);
    }
    return some;
  }
  void see(std::size_t pair, const std::vector<Point>& points, const SE3& T_nav_cam) {
    if (seen.size() <= pair) seen.resize(pair + 1);
    closure::FrameFeatures& into = seen[pair];
    for (const Point& p : points) {
      const Eigen::Vector3d in_left = T_nav_cam.inverse() * p.place;
      const Eigen::Vector2d left = rig.left.project(in_left);
      if (!rig.left.contains(left, 2)) continue;
      constexpr float kAcross = 1e-6F, kAlong = 1e-5F;  // [m^2]
      closure::Feature feature;
      feature.left = left.cast<float>();
      feature.right = rig.right.project(rig.T_right_left * in_left).cast<float>();
      feature.point = in_left.cast<float>();
      feature.covariance = {kAcross, 0, 0, kAcross, 0, kAlong};
      feature.size = 8;
      into.features.push_back(feature);
      into.descriptors.insert(into.descriptors.end(), p.looks.begin(), p.looks.end());
    }
  }
  [[nodiscard]] std::size_t count(std::size_t pair) const override { return seen[pair].size(); }
  void load(std::size_t pair, closure::FrameFeatures& out) const override { out = seen[pair]; }
};

TEST(VisualOdometry, AStepThatTurnsOtherwiseThanDeadReckoningIsConfirmedByThePairBeforeItAlone) {
  constexpr double kStepped = 0.06;  // [rad]
  constexpr std::uint32_t kPairs = 5, kAt = 3;
  for (const bool compass : {true, false}) {
    SeenGround ground;
    const auto reef = ground.points(1500), shoal = ground.points(4000);
    Frames frames;
    frames.features = &ground;
    for (std::uint32_t k = 0; k < kPairs; ++k) {
      const auto pose = [&](double heading) {
        return SE3::fromEuler(0, 0, heading, {kFrameStep * k, 0, 10});
      };
      const double stepped = k >= kAt ? kStepped : 0;
      ground.see(k, reef, pose(0));
      // Turning with the vehicle, in two pairs only: a false link.
      if (!compass && (k == kAt || k + 1 == kAt)) ground.see(k, shoal, pose(stepped));
      frames.pair.push_back(k);
      frames.reckoned.push_back(pose(compass ? stepped : 0));
      frames.range.push_back(kCameraAltitude);
      frames.travelled.push_back(kFrameStep * k);
    }
    const std::vector<slam::NavigationLink> links = visualOdometry(ground.rig, frames);
    ASSERT_EQ(links.size(), kPairs - 1);
    for (const slam::NavigationLink& link : links) {
      EXPECT_EQ(link.confirmed, compass && link.b == kAt) << link.b;
      const double turn = link.T_a_b.rotation().angularDistance(Eigen::Quaterniond::Identity());
      EXPECT_NEAR(turn, !compass && link.b == kAt ? kStepped : 0, 0.002) << link.b;
    }
  }
}

}  // namespace
}  // namespace fathom::topside

#include <gmock/gmock.h>

#include <algorithm>
#include <random>
#include <set>
#include <utility>

#include "recon/solver/batch/batch_solver.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/missions.hpp"

namespace fathom::topside {
namespace {

constexpr int kFrames = 60;        // of the outward track, and as many back
constexpr double kStep = 0.25;     // [m]
constexpr double kAltitude = 2.0;  // [m]

// Frames that have one feature each: nothing can be registered.
struct OneFeatureEach final : FeatureStore {
  [[nodiscard]] std::size_t count(std::size_t) const override { return 1; }
  void load(std::size_t, closure::FrameFeatures& out) const override {
    out.features.assign(1, {});
    out.descriptors.assign(closure::kDescriptorBytes, 0);
  }
};

// A straight track out and back over the same ground, known by dead reckoning alone.
struct OutAndBack {
  OneFeatureEach store;
  Frames frames;
  slam::NavigationSolution solution;

  explicit OutAndBack(double sigma_of_a_step) {
    frames.features = &store;
    solution.graph.poses.emplace_back();
    for (int k = 0; k < 2 * kFrames; ++k) {
      const double along = kStep * (k < kFrames ? k : 2 * kFrames - 1 - k);
      // Looking down, as a camera does.
      const SE3 pose = SE3::fromEuler(0, 0, k < kFrames ? 0 : M_PI, {along, 0, 10});
      frames.pair.push_back(static_cast<std::uint32_t>(k));
      frames.reckoned.push_back(pose);
      frames.range.push_back(kAltitude);
      frames.travelled.push_back(kStep * k);
      solution.poses.push_back(pose);
      solution.nodes.push_back(k + 1);
      const SE3& before = solution.graph.poses.back();
      Vector6d information = Vector6d::Constant(1e8);
      if (k > 0) information.head<2>().setConstant(1 / (sigma_of_a_step * sigma_of_a_step));
      solution.graph.edges.push_back({k, k + 1, before.inverse() * pose, Matrix6d(information.asDiagonal())});
      solution.graph.poses.push_back(pose);
    }
  }
  // The return track found to be elsewhere.
  void shiftBack(const Eigen::Vector3d& by) {
    for (std::size_t k = kFrames; k < solution.poses.size(); ++k) {
      solution.poses[k] = SE3(solution.poses[k].rotation(), solution.poses[k].translation() + by);
      solution.graph.poses[k + 1] = solution.poses[k];
    }
  }
};

std::set<std::pair<std::uint32_t, std::uint32_t>> pairsOf(const std::vector<Attempt>& attempts) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> pairs;
  for (const Attempt& t : attempts) pairs.emplace(t.a, t.b);
  return pairs;
}

TEST(BatchClosureSearch, APairThatWasRefusedComesAgainOnlyOnceItsPriorHasMovedBySeveralSigmas) {
  OutAndBack dive(0.005);
  const StereoRig rig = test::TinyMission::rig();
  BatchClosureSearch search(rig, dive.frames, 0);
  const auto round = [&] {
    search.look(dive.solution, {});
    std::vector<Attempt> attempts = search.candidates(100000, 100);
    EXPECT_TRUE(search.attempt(attempts).empty());
    return attempts;
  };
  const auto first = pairsOf(round());
  EXPECT_GT(first.size(), 200U);
  dive.shiftBack({0, 0.02, 0});
  EXPECT_TRUE(round().empty());
  dive.shiftBack({0, 0.7, 0});
  std::size_t again = 0;
  for (const auto& pair : pairsOf(round())) again += first.count(pair);
  EXPECT_GT(again, first.size() / 4);
}

TEST(BatchClosureSearch, LookingForWhatIsLostInEveryDirectionItSaysWhatNoClosureHasVerified) {
  OutAndBack dive(0.5);  // 4 m in the end, several footprints
  const StereoRig rig = test::TinyMission::rig();
  BatchClosureSearch search(rig, dive.frames, 0);
  search.look(dive.solution, {});
  const std::vector<Attempt> attempts = search.candidates(100000, 6);
  std::set<std::uint32_t> newer;
  for (const Attempt& t : attempts) newer.insert(t.b);
  EXPECT_GT(newer.size(), 50U);
  const Crossings lost = search.crossings({});
  EXPECT_NEAR(lost.expected, 1.5, 0.5);  // of 15 m, in probability
  EXPECT_DOUBLE_EQ(lost.unverified, lost.expected);
  std::vector<slam::NavigationLink> links(1);
  links[0].a = 30;
  links[0].b = 90;
  const Crossings one = search.crossings(links);
  EXPECT_DOUBLE_EQ(one.expected, lost.expected);
  EXPECT_LT(one.unverified, lost.unverified);
}

TEST(BatchClosureSearch, FramesOnBothSidesOfAStepThatOdometryMissedAreTried) {
  constexpr std::uint32_t kMissed = 20, kClosureApart = 4;
  OutAndBack dive(0.1);
  std::vector<slam::NavigationLink> links;
  for (std::uint32_t k = 1; k < dive.frames.pair.size(); ++k) {
    if (k == kMissed) continue;
    links.emplace_back();
    links.back().a = k - 1, links.back().b = k;
  }
  const StereoRig rig = test::TinyMission::rig();
  BatchClosureSearch search(rig, dive.frames, 0);
  search.look(dive.solution, links);
  std::set<std::pair<std::uint32_t, std::uint32_t>> near;
  for (const auto& pair : pairsOf(search.candidates(100000, 100)))
    if (pair.second < pair.first + kClosureApart) near.insert(pair);
  EXPECT_EQ(near, (std::set<std::pair<std::uint32_t, std::uint32_t>>{
                      {17, 20}, {18, 20}, {18, 21}, {19, 21}, {19, 22}}));
}

// Disparities that slope across the track turn every step to the same side; where the vehicle comes back
// over its outward track, closures contradict that.
TEST(BatchClosureSearch, FindsTheErrorThatAllLinksShareAndTakesItOut) {
  constexpr int kSlope = 5;  // column of closure::poseBySharedErrors()
  OutAndBack dive(0.005);
  const StereoRig rig = test::TinyMission::rig();
  BatchClosureSearch search(rig, dive.frames, 0);
  std::vector<slam::NavigationLink> right;
  const auto join = [&](int a, int b) {
    slam::NavigationLink link;
    link.a = static_cast<std::uint32_t>(a);
    link.b = static_cast<std::uint32_t>(b);
    link.T_a_b = dive.frames.reckoned[link.a].inverse() * dive.frames.reckoned[link.b];
    link.covariance = covarianceOf(0.0005, 0.0005);
    right.push_back(link);
  };
  for (int k = 0; k + 1 < 2 * kFrames; ++k) join(k, k + 1);
  for (int k = 0; k + 1 < kFrames; k += 3) join(k, 2 * kFrames - 1 - k);
  BatchClosureSearch::Shared error = BatchClosureSearch::Shared::Zero();
  error(kSlope) = 2;
  const std::vector<slam::NavigationLink> seen = search.straightened(right, -error);
  const auto worst = [&](const std::vector<slam::NavigationLink>& links) {
    double turn = 0;
    for (std::size_t i = 0; i < links.size(); ++i)
      turn = std::max(turn, links[i].T_a_b.rotation().angularDistance(right[i].T_a_b.rotation()));
    return turn;
  };
  ASSERT_GT(worst(seen), 3e-4);

  std::vector<slam::NavigationLink> links = seen;
  BatchClosureSearch::Shared found = BatchClosureSearch::Shared::Zero();
  for (int round = 0; round < 2; ++round) {
    links = search.straightened(seen, found);
    dive.solution.graph.edges.resize(1);  // the first pose's own
    for (slam::NavigationLink& link : links) {
      link.edge = static_cast<int>(dive.solution.graph.edges.size());
      dive.solution.graph.edges.push_back(slam::linkFactor(
          dive.solution.nodes[link.a], dive.solution.nodes[link.b], link.T_a_b, link.covariance));
    }
    slam::optimize(dive.solution.graph, {});
    dive.solution.poses.assign(dive.solution.graph.poses.begin() + 1, dive.solution.graph.poses.end());
    search.look(dive.solution, links, found);
    found = search.known().shared();
  }
  EXPECT_NEAR(found(kSlope), 2, 0.1);
  EXPECT_LT(worst(search.straightened(seen, found)), 0.05 * worst(seen));
  // What bundle adjustment takes out of disparities: so much at a tangent of 0.5 [px].
  EXPECT_NEAR(search.disparityError(found, {0.2, 0.5}),
              0.5 * found(kSlope) * closure::SharedErrors().disparity_slope, 0.01);
}

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
      into.features.push_back({.left = left.cast<float>(),
                               .right = rig.right.project(rig.T_right_left * in_left).cast<float>(),
                               .point = in_left.cast<float>(),
                               .covariance = {kAcross, 0, 0, kAcross, 0, kAlong},
                               .size = 8});
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

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <random>
#include <set>
#include <utility>

#include "recon/solver/batch/batch_solver.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/localise/batch_closure_search.hpp"
#include "recon/topside/localise/first_links.hpp"
#include "recon/topside/report/overlap_colours.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/slam_report.hpp"
#include "tests/support/key_tables.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
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

Mesh square(float north, float east, float size, float depth) {
  Mesh mesh;
  for (const float n : {north, north + size})
    for (const float e : {east, east + size}) mesh.vertices.emplace_back(n, e, depth);
  mesh.triangles = {{0, 1, 3}, {0, 3, 2}};
  mesh.colours.assign(4, Rgb{200, 100, 50});
  computeNormals(mesh);
  return mesh;
}

void append(Mesh& to, const Mesh& from) {
  const auto offset = static_cast<std::uint32_t>(to.vertices.size());
  to.vertices.insert(to.vertices.end(), from.vertices.begin(), from.vertices.end());
  to.normals.insert(to.normals.end(), from.normals.begin(), from.normals.end());
  to.colours.insert(to.colours.end(), from.colours.begin(), from.colours.end());
  for (const auto& [a, b, c] : from.triangles) to.triangles.push_back({a + offset, b + offset, c + offset});
}

std::string configError(const std::string& text) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << text;
  return test::refusal([&] { (void)readTopsideConfig(folder.path() / "run.toml"); });
}

TEST(TopsideConfig, AnUnknownKeyOrAValueOutOfRangeIsNamed) {
  EXPECT_THAT(configError("[fusion]\nvoxels_m = 0.02\n"), ::testing::HasSubstr("voxels_m"));
  EXPECT_THAT(configError("[fusion]\nvoxel_m = -1\n"), ::testing::HasSubstr("voxel_m"));
  EXPECT_THAT(configError("[stereo]\nwindow_px = 14\n"), ::testing::HasSubstr("odd"));
  EXPECT_THAT(configError("[stereo]\nmin_range_m = 5\nmax_range_m = 2\n"),
              ::testing::HasSubstr("max_range_m"));
  EXPECT_THAT(configError("[slam]\nturned_sigmas = 0\n"), ::testing::HasSubstr("turned_sigmas"));
  EXPECT_THAT(configError("[model]\ntexel_m = 0.00001\n"), ::testing::HasSubstr("texel_m"));
  EXPECT_EQ(configError("[fusion]\nvoxel_m = 0.05\n[stereo]\nmax_features = 1000\n"), "");
}

TEST(TopsideConfig, WhenTheCompassContradictsALinkCanBeSaid) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << "[slam]\nturned_sigmas = 2.5\n";
  EXPECT_EQ(readTopsideConfig(folder.path() / "run.toml").navigation.turned_sigmas, 2.5);
}

TEST(TopsideConfig, WhatIsPrintedReadsAsTheSameAndThePagesHaveIt) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "run.toml";
  std::ofstream(file) << "[fusion]\nvoxel_m = 0.05\ncarve = false\n[stereo]\nmethod = \"dense\"\n";
  const std::string printed = topsideToml(readTopsideConfig(file));
  EXPECT_THAT(printed,
              ::testing::HasSubstr("voxel_m = 0.05  # [m] 0.002 to 2.0, default 0.033: edge of a voxel\n"));
  std::ofstream(file) << printed;
  EXPECT_EQ(topsideToml(readTopsideConfig(file)), printed);

  TopsideConfig defaults;
  ConfigListing listing;
  visitTopside(listing, defaults);
  test::expectPagesHoldKeys(FATHOM_SOURCE_DIR "/recon", "topside", listing);
}

TEST(TopsideConfig, TheBandFollowsTheVoxelUnlessItIsSet) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "run.toml") << "[fusion]\nvoxel_m = 0.1\n";
  EXPECT_DOUBLE_EQ(readTopsideConfig(folder.path() / "run.toml").fusion.truncation, 0.3);
  std::ofstream(folder.path() / "run.toml") << "[fusion]\nvoxel_m = 0.1\ntruncation_m = 0.15\n";
  EXPECT_DOUBLE_EQ(readTopsideConfig(folder.path() / "run.toml").fusion.truncation, 0.15);
}

// The mesh in two parts.
MapPicture drawn(const Mesh& mesh, int max_pixels, double min_metres) {
  MapExtent extent;
  extent.add(mesh);
  MapPainter painter(extent, max_pixels, min_metres);
  Mesh part = mesh;
  const auto middle = mesh.triangles.begin() + static_cast<std::ptrdiff_t>(mesh.triangles.size() / 2);
  part.triangles.assign(mesh.triangles.begin(), middle);
  painter.add(part);
  part.triangles.assign(middle, mesh.triangles.end());
  painter.add(part);
  return painter.take();
}

TEST(MapPicture, NorthIsUpEastIsRightAndTheUpperSurfaceIsSeen) {
  Mesh mesh = square(0, 0, 1, 10);   // south-west
  append(mesh, square(1, 1, 1, 5));  // north-east, shallower
  append(mesh, square(1, 1, 1, 9));  // hidden below it
  const MapPicture picture = drawn(mesh, 100, 0.001);
  ASSERT_EQ(picture.width, 100);
  ASSERT_EQ(picture.height, 100);
  const auto at = [&](int row, int column) {
    return &picture.rgb[static_cast<std::size_t>(row * 100 + column) * 3];
  };
  EXPECT_EQ(at(25, 25)[0], 255);  // nothing there: background
  EXPECT_EQ(at(75, 75)[0], 255);
  const auto brightness = [&](const std::uint8_t* p) { return p[0] + p[1] + p[2]; };
  EXPECT_GT(brightness(at(25, 75)), brightness(at(75, 25)) + 100);  // shallow is light
  EXPECT_NEAR(picture.rgb_texture[(25 * 100 + 75) * 3], 200, 3);
  EXPECT_EQ(toPng(picture.rgb, picture.width, picture.height).substr(1, 3), "PNG");
  EXPECT_TRUE(drawn(Mesh{}, 100, 0.01).rgb.empty());
}

TEST(Crossovers, OnlyComingBackLaterIsACrossover) {
  std::vector<FusedPair> pairs(4);
  const std::array<double, 4> seconds = {0, 10, 100, 200}, north = {0, 0.5, 0.2, 50};
  for (std::size_t k = 0; k < 4; ++k) {
    pairs[k].pair.utc_ns = static_cast<std::int64_t>(seconds[k] * 1e9);
    pairs[k].T_nav_cam = SE3(Eigen::Quaterniond::Identity(), {north[k], 0, 0});
    pairs[k].footprint_radius = 0.7;
  }
  EXPECT_EQ(likelyCrossovers(pairs), (std::vector<bool>{true, true, true, false}));
  pairs.erase(pairs.begin() + 2);
  EXPECT_EQ(likelyCrossovers(pairs), (std::vector<bool>{false, false, false}));
}

TEST(PoseOutput, NamesInTablesAreOneField) {
  const test::TemporaryFolder folder;
  slam::NavigationLink link;
  link.a = 0, link.b = 1;
  writeClosures(folder.path() / "closures.csv", {{0, "left/a, 1.png", ""}, {1, "left/\"b\".png", ""}},
                {link});
  EXPECT_THAT(test::readText(folder.path() / "closures.csv"),
              ::testing::HasSubstr("\n\"left/a, 1.png\",\"left/\"\"b\"\".png\",0.00000"));
}

TEST(SlamWarnings, TellThatCrossingsWereNotVerifiedAndThatTheSolverDidNotConverge) {
  SlamResult slam;
  slam.crossings_expected = 400;
  slam.crossings_unverified = 30;  // what chance leaves
  EXPECT_TRUE(slamWarnings(slam).empty());
  slam.crossings_unverified = 380;
  ASSERT_EQ(slamWarnings(slam).size(), 1U);
  EXPECT_THAT(slamWarnings(slam)[0], ::testing::HasSubstr("380 m of the 400 m"));
  slam.converged = false;
  EXPECT_EQ(slamWarnings(slam).size(), 2U);
  EXPECT_EQ(web::jsonOf(slamFields(slam)).at("warnings").size(), 2U);
  slam.mounting.camera_turn.y() = -0.05;
  slam.mounting.camera_turn_sigma.y() = 0.002;
  ASSERT_EQ(slamWarnings(slam).size(), 3U);
  EXPECT_THAT(slamWarnings(slam)[2],
              ::testing::HasSubstr("pitch by -2.86 (standard deviation 0.11) degrees"));
  slam.mounting.camera_turn_sigma.y() = 0.02;
  EXPECT_EQ(slamWarnings(slam).size(), 2U) << "it may be chance";
}

}  // namespace
}  // namespace fathom::topside

#include "recon/navigation/graph/navigation_graph.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <stdexcept>

#include "tests/world/dive.hpp"

namespace fathom::slam {
namespace {

using testing::drive, testing::errorsOf, testing::makeDive, testing::posesOf, testing::smallConfig;
using testing::SyntheticDive, testing::SyntheticDiveOptions;

std::vector<SE3> reckonedOf(const SyntheticDive& survey) {
  std::vector<SE3> poses;
  for (const KeyframeInput& input : survey.inputs) poses.push_back(input.T_odom_cam);
  return poses;
}

// A dive, and the graph that was driven through it.
struct Driven {
  explicit Driven(const SyntheticDiveOptions& options = {}, const NavigationConfig& config = smallConfig())
      : survey(makeDive(options)), graph(config) {
    drive(graph, survey, options);
  }
  SyntheticDive survey;
  NavigationGraph graph;
};

double nees(NavigationGraph& graph, const SyntheticDive& survey, int k) {
  return testing::squaredError(graph.pose(k), survey.truth[static_cast<std::size_t>(k)], graph.covariance(k));
}

TEST(NavigationGraph, ClosuresTakeOutTheDriftOfDeadReckoning) {
  auto [survey, graph] = Driven();
  ASSERT_EQ(graph.keyframes(), static_cast<int>(survey.truth.size()));
  const double before = errorsOf(reckonedOf(survey), survey.truth).aligned;
  const double after = errorsOf(posesOf(graph), survey.truth).aligned;
  EXPECT_LT(after, 0.1 * before) << before;
  EXPECT_LT(after, 0.02);
  EXPECT_EQ(graph.counters().links_contradicting, 0U);
  EXPECT_EQ(graph.counters().steps_contradicted, 0U);
}

TEST(NavigationGraph, ItsCovarianceIsConsistentOverManySurveys) {
  // Sum of the NEES at a few poses of each survey; those of one survey hang together, surveys do not.
  SyntheticDiveOptions options{.lines = 3, .line_length = 10};
  NavigationConfig config = smallConfig();
  config.noise = testing::syntheticNoise();
  constexpr int kSurveys = 40;
  double newest = 0, middle = 0, relative = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    auto [survey, graph] = Driven(options, config);
    const int last = graph.keyframes() - 1;
    newest += nees(graph, survey, last);
    middle += nees(graph, survey, last / 2);
    const NavigationGraph::Prediction seen = graph.predict(last / 3, last);
    relative += testing::squaredError(seen.T_a_b,
                                      survey.truth[static_cast<std::size_t>(last / 3)].inverse() *
                                          survey.truth[static_cast<std::size_t>(last)],
                                      seen.covariance);
  }
  // 95 % of chi-square with 240 degrees of freedom, over 40.
  constexpr double kLow = 4.97, kHigh = 7.12;
  for (const double sum : {newest, middle, relative}) {
    SCOPED_TRACE(sum / kSurveys);
    EXPECT_GT(sum / kSurveys, kLow);
    EXPECT_LT(sum / kSurveys, kHigh);
  }
}

// Of every keyframe but the last few, horizontally, in its own covariance [2 degrees of freedom].
double farthest(NavigationGraph& graph, const SyntheticDive& survey) {
  double worst = 0;
  for (int k = 0; k < graph.keyframes(); k += 10) {
    const Eigen::Matrix3d R = graph.pose(k).matrix3();
    const Eigen::Matrix3d spread = R * graph.covariance(k).topLeftCorner<3, 3>() * R.transpose();
    const Eigen::Vector2d off =
        (graph.pose(k).translation() - survey.truth[static_cast<std::size_t>(k)].translation()).head<2>();
    worst = std::max(worst, off.dot(spread.topLeftCorner<2, 2>().inverse() * off));
  }
  return worst;
}

TEST(NavigationGraph, ClaimsWhatAllPositionsOfAUsblShareAndFindsItByGps) {
  SyntheticDiveOptions options{.lines = 3, .bias_from = 0, .usbl_turn = 0.03, .ship = {40, -20}};
  constexpr double kGps = 0.3;  // [m]
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    options.seed = seed;
    options.bias = Eigen::Rotation2Dd(0.8 * static_cast<double>(seed)) * Eigen::Vector2d(4, 0);
    const SyntheticDive survey = makeDive(options);
    NavigationGraph alone(smallConfig()), with_gps(smallConfig());
    alone.setUsblAnchor(options.bias + Eigen::Vector2d(0.3, -0.2), 0.4);
    with_gps.setAnchor(Eigen::Vector2d(0.2, 0.1), kGps);
    for (NavigationGraph* graph : {&alone, &with_gps}) {
      testing::driveOn(*graph, survey, options, static_cast<int>(survey.inputs.size()));
      EXPECT_LT(farthest(*graph, survey), 9) << seed;
      EXPECT_LE(graph->counters().fixes_gated, 1U);
    }
    EXPECT_GT(errorsOf(posesOf(alone), survey.truth).absolute, 2.5) << seed;
    EXPECT_LT(errorsOf(posesOf(with_gps), survey.truth).absolute, 2 * kGps) << seed;
    const Eigen::Vector2d seen = survey.fixes.front().north_east,
                          place = options.ship + Eigen::Rotation2Dd(-options.usbl_turn) *
                                                     (seen - options.bias - options.ship);
    const SE3 found = with_gps.usblCorrection();
    EXPECT_LT((found.translation().head<2>() - (place - seen)).norm(), 3 * kGps) << seed;
  }
}

// Steps that are known to a third of a millimetre, taken again, in a graph that nothing holds: what the
// factor knows of them must not be lost in rounding. The first position then moves it all.
TEST(NavigationGraph, WhatNothingHoldsIsStillKnownWithinItself) {
  SyntheticDiveOptions options{.lines = 6, .closure_share = 0, .usbl_period = 1e9};
  SyntheticDive survey = makeDive(options);
  survey.link_covariance /= 40;
  NavigationGraph graph(smallConfig());
  testing::driveOn(graph, survey, options, static_cast<int>(survey.inputs.size()));
  const int last = graph.keyframes() - 1;
  const auto placeSigma = [](const Matrix6d& covariance) {
    return std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  };
  for (int round = 0; round < 3; ++round)
    for (const SyntheticDive::Link& link : survey.visual) {
      graph.renewOdometry(link.b, link.T_a_b, survey.link_covariance);
      (void)graph.step();
      const double sigma = placeSigma(graph.predict(0, last).covariance);
      ASSERT_GT(sigma, 0.01) << link.b;
      ASSERT_LT(sigma, 0.5) << link.b;
    }
  EXPECT_GT(placeSigma(graph.covariance(last)), 900);
  const Eigen::Vector2d far(700, -300);
  ASSERT_EQ(graph.addFix(last, survey.inputs.back().T_odom_cam.translation(), far, 0.5, false), Taken::kYes);
  for (int i = 0; i < 30; ++i) (void)graph.step();
  EXPECT_LT((graph.pose(last).translation().head<2>() - far).norm(), 0.05);
  EXPECT_LT(placeSigma(graph.covariance(last)), 1);
}

TEST(NavigationGraph, ClaimsAScaleThatAllPathsShareUntilAFixFarAwayMeasuresIt) {
  SyntheticDiveOptions options{.lines = 1, .line_length = 120, .closure_share = 0, .usbl_period = 1e9};
  constexpr double kAnchor = 0.1;  // [m]
  constexpr int kFar = 235;        // keyframe near the line's end
  NavigationConfig config = smallConfig();
  config.noise.visual_scale = 0.002;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    options.seed = seed;
    SyntheticDive survey = makeDive(options);
    const double scale = seed % 2 == 0 ? 0.996 : 1.004;
    for (SyntheticDive::Link& link : survey.visual)
      link.T_a_b = SE3(link.T_a_b.rotation(), scale * link.T_a_b.translation());
    NavigationGraph graph(config);
    graph.setAnchor(Eigen::Vector2d::Zero(), kAnchor);
    testing::driveOn(graph, survey, options, kFar + 1);
    EXPECT_LT(farthest(graph, survey), 9) << seed;
    const auto sigma = [&] {
      const Eigen::Matrix3d R = graph.pose(kFar).matrix3();
      return std::sqrt((R * graph.covariance(kFar).topLeftCorner<3, 3>() * R.transpose())(0, 0));
    };
    EXPECT_GT(sigma(), 0.9 * config.noise.visual_scale * options.line_length) << seed;
    const auto at_far = static_cast<std::size_t>(kFar);
    const Eigen::Vector3d& camera = survey.inputs[at_far].T_odom_cam.translation();
    ASSERT_EQ(graph.addFix(kFar, camera, survey.truth[at_far].translation().head<2>(), kAnchor, false),
              Taken::kYes);
    (void)graph.step();
    EXPECT_LT(sigma(), 1.5 * kAnchor) << seed;
  }
}

TEST(NavigationGraph, ClaimsATiltBiasOfTheBodyThatHalfATurnReverses) {
  SyntheticDiveOptions options;
  options.visual_share = options.closure_share = 0;
  options.lines = 2;
  for (const int axis : {0, 1}) {
    SyntheticDive survey = makeDive(options);
    const double size = std::copysign(0.0087, survey.tilt_bias(axis));
    const Eigen::Quaterniond bias(Eigen::AngleAxisd(size, Eigen::Vector3d::Unit(axis)));
    for (KeyframeInput& input : survey.inputs)
      input.T_odom_cam = SE3(input.T_odom_cam.rotation() * bias, input.T_odom_cam.translation());
    NavigationGraph graph(smallConfig());
    drive(graph, survey, options);
    constexpr int kThere = 15, kBack = 50;  // in the middle of either line
    const NavigationGraph::Prediction seen = graph.predict(kThere, kBack);
    const SE3 truth = survey.truth[kThere].inverse() * survey.truth[kBack];
    const Eigen::Vector2d off = (seen.T_a_b.inverse() * truth).log().segment<2>(3);
    EXPECT_GT(off.norm(), 0.012);
    EXPECT_LT(off.dot(seen.covariance.block<2, 2>(3, 3).inverse() * off), 4.5);
  }
}

TEST(NavigationGraph, AFirstOutlierOfTheUsblDoesNotRejectThePositionsAfterIt) {
  const SyntheticDiveOptions options;
  SyntheticDive survey = makeDive(options);
  NavigationGraph without(smallConfig()), graph(smallConfig());
  drive(without, survey, options);
  survey.fixes.front().north_east += Eigen::Vector2d(6, 5);
  drive(graph, survey, options);
  EXPECT_EQ(graph.counters().fixes_gated, 0U);
  EXPECT_EQ(graph.counters().fixes_off, 1U);
  EXPECT_LT(errorsOf(posesOf(graph), posesOf(without)).absolute, 0.1);
}

TEST(NavigationGraph, DeadReckoningAloneIsConsistentToo) {
  SyntheticDiveOptions options{.closure_share = 0, .visual_share = 0};
  NavigationConfig config = smallConfig();
  config.noise = testing::syntheticNoise();
  constexpr int kSurveys = 40;
  double sum = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    auto [survey, graph] = Driven(options, config);
    sum += nees(graph, survey, graph.keyframes() - 1);
  }
  EXPECT_GT(sum / kSurveys, 0.5 * 6);
  EXPECT_LT(sum / kSurveys, 1.5 * 6);
}

TEST(NavigationGraph, FindsScaleAndMisalignmentOfTheDvl) {
  const SyntheticDiveOptions options;
  for (const std::uint64_t seed : {3U, 4U, 5U}) {
    auto [survey, graph] = Driven({.seed = seed});
    EXPECT_NEAR(graph.dvl().scale(), -survey.dvl_scale, 4 * std::sqrt(graph.dvl().covariance()(0, 0)));
    EXPECT_NEAR(graph.dvl().heading(), survey.dvl_heading, 4 * std::sqrt(graph.dvl().covariance()(1, 1)));
    EXPECT_LT(graph.dvl().remainingShare(), 0.002);
    EXPECT_EQ(graph.dvl().restarts(), 0U);
  }
}

TEST(NavigationGraph, SurvivesADeadDvlAJumpingCompassAndWildFixes) {
  SyntheticDiveOptions options{.usbl_period = 2,
                               .wild_fixes = 0.1,
                               .dvl_dead_from = 40,
                               .dvl_dead_to = 100,
                               .jump_at = 70,
                               .jump = 20 * 3.14159265 / 180,
                               .jump_known = false};
  const SyntheticDive survey = makeDive(options);
  NavigationConfig config = smallConfig();
  config.noise.usbl_shift = 0;  // positions that share nothing
  NavigationGraph graph(config);
  drive(graph, survey, options);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).aligned, 0.02);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).absolute, 0.5);
  const NavigationGraph::Counters& c = graph.counters();
  EXPECT_GE(c.dvl_absent, 59U);
  EXPECT_GE(c.steps_contradicted, 1U);
  EXPECT_GE(c.fixes_gated + c.fixes_off, 2U);
}

TEST(NavigationGraph, AnOutlierOfTheDvlIsRejectedAndTheDvlAcceptedAgainLater) {
  SyntheticDiveOptions options{.outlier_from = 30, .outlier_to = 60, .outlier = 0.2};
  const SyntheticDive survey = makeDive(options);
  NavigationGraph graph(smallConfig());
  graph.setAnchor(survey.anchor, options.anchor_sigma);
  bool noticed = false;
  for (std::size_t k = 0; k < survey.inputs.size(); ++k) {
    ASSERT_TRUE(graph.addKeyframe(survey.inputs[k]));
    if (k > 0)
      (void)graph.addLink(LinkKind::kOdometry, static_cast<int>(k) - 1, static_cast<int>(k),
                          survey.visual[k - 1].T_a_b, survey.link_covariance);
    (void)graph.step();
    noticed = noticed || graph.counters().dvl_rejected;
  }
  EXPECT_TRUE(noticed);
  EXPECT_FALSE(graph.counters().dvl_rejected);
  EXPECT_GE(graph.counters().steps_left_out, 25U);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).aligned, 0.1);
}

TEST(NavigationGraph, AFalseClosureIsRejectedOrSwitchedOff) {
  auto [survey, graph] = Driven();
  const std::vector<SE3> before = posesOf(graph);
  const SE3 false_pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, 0, 0));
  EXPECT_EQ(graph.addLink(LinkKind::kClosure, 5, graph.keyframes() - 1, false_pose, survey.link_covariance),
            Taken::kContradicts);
  EXPECT_EQ(graph.counters().links_contradicting, 1U);
}

TEST(NavigationGraph, ContradictionsDependOnTheScaleOfItsOwnCovariance) {
  const SyntheticDiveOptions options;
  const SyntheticDive survey = makeDive(options);
  NavigationConfig config = smallConfig();
  config.known_scale = 1e9;
  NavigationGraph graph(config);
  drive(graph, survey, options);
  const SE3 false_pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, 0, 0));
  EXPECT_EQ(graph.addLink(LinkKind::kClosure, 5, graph.keyframes() - 1, false_pose, survey.link_covariance),
            Taken::kYes);
  EXPECT_EQ(graph.addFix(5, survey.inputs[5].T_odom_cam.translation(), {50, 50}, 0.5, false), Taken::kYes);
  config.known_scale = 0.9;
  EXPECT_THROW(NavigationGraph{config}, std::invalid_argument);
}

TEST(NavigationGraph, AFalseClosureThatCameFirstIsSwitchedOffByTrueOnes) {
  SyntheticDiveOptions options;
  options.visual_share = options.closure_share = 0;  // dead reckoning alone does not show it
  const SyntheticDive survey = makeDive(options);
  NavigationConfig config = smallConfig();
  config.rig.curl = 0;  // or attitudes share the tilt out between closures and poses
  NavigationGraph graph(config);
  drive(graph, survey, options);
  const int last = graph.keyframes() - 1, older = 20;
  const SE3 right = survey.truth[20].inverse() * survey.truth.back();
  const SE3 wrong(right.rotation(), right.translation() + Eigen::Vector3d(0.1, 0.1, 0));
  ASSERT_EQ(graph.addLink(LinkKind::kClosure, older, last, wrong, survey.link_covariance), Taken::kYes);
  for (int i = 0; i < 20; ++i) (void)graph.step();
  for (int i = 0; i < 10; ++i) {
    (void)graph.addLink(LinkKind::kClosure, older, last, right, survey.link_covariance);
    for (int k = 0; k < 10; ++k) (void)graph.step();
  }
  EXPECT_EQ(graph.counters().links_off, 1U);
  const SE3 off = right.inverse() * graph.predict(older, last).T_a_b;
  EXPECT_LT(off.translation().norm(), 0.002);
}

TEST(NavigationGraph, GivesKeyframesThatMovedTheFarthestFirst) {
  auto [survey, graph] = Driven();
  ASSERT_GT(graph.changesWaiting(), 10U);
  std::size_t taken = 0;
  const std::size_t waiting = graph.changesWaiting();
  while (graph.takeChange()) ++taken;
  EXPECT_EQ(taken, waiting);
  EXPECT_EQ(graph.changesWaiting(), 0U);
}

TEST(NavigationGraph, SameCallsGiveTheSameBytes) {
  const SyntheticDiveOptions options;
  const SyntheticDive survey = makeDive(options);
  NavigationGraph first(smallConfig()), second(smallConfig());
  drive(first, survey, options);
  drive(second, survey, options);
  for (int k = 0; k < first.keyframes(); ++k) {
    EXPECT_EQ(first.pose(k).translation(), second.pose(k).translation());
    EXPECT_EQ(first.pose(k).rotation().coeffs(), second.pose(k).rotation().coeffs());
  }
}

TEST(NavigationGraph, FullIsCountedAndNonsenseRefused) {
  NavigationConfig config = smallConfig();
  config.max_keyframes = 3;
  config.max_links = 1;
  config.max_fixes = 0;
  NavigationGraph graph(config);
  KeyframeInput input;
  for (int k = 0; k < 3; ++k) {
    input.utc_ns += 1'000'000'000;
    ASSERT_TRUE(graph.addKeyframe(input));
  }
  EXPECT_FALSE(graph.addKeyframe(input));
  EXPECT_EQ(graph.counters().keyframes_refused, 1U);
  const Matrix6d covariance = Matrix6d::Identity() * 1e-4;
  EXPECT_EQ(graph.addLink(LinkKind::kClosure, 0, 7, SE3(), covariance), Taken::kBad);
  EXPECT_EQ(graph.addFix(0, Eigen::Vector3d::Zero(), {0, 0}, -1, false), Taken::kBad);
  config.max_keyframes = 0;
  EXPECT_THROW(NavigationGraph{config}, std::invalid_argument);
}

}  // namespace
}  // namespace fathom::slam

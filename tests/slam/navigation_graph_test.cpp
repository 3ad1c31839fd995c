#include "recon/slam/navigation_graph.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <stdexcept>

#include "tests/slam/made_survey.hpp"

namespace fathom::slam {
namespace {

using testing::drive;
using testing::errorsOf;
using testing::MadeSurvey;
using testing::MadeSurveyOptions;
using testing::makeSurvey;
using testing::smallConfig;

std::vector<SE3> posesOf(const NavigationGraph& graph) {
  std::vector<SE3> poses;
  for (int k = 0; k < graph.keyframes(); ++k) poses.push_back(graph.pose(k));
  return poses;
}

std::vector<SE3> reckonedOf(const MadeSurvey& survey) {
  std::vector<SE3> poses;
  for (const KeyframeInput& input : survey.inputs) poses.push_back(input.T_odom_cam);
  return poses;
}

double nees(NavigationGraph& graph, const MadeSurvey& survey, int k) {
  return testing::squaredError(graph.pose(k), survey.truth[static_cast<std::size_t>(k)], graph.covariance(k));
}

TEST(NavigationGraph, ClosuresTakeOutTheDriftOfDeadReckoning) {
  const MadeSurveyOptions options;
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  ASSERT_EQ(graph.keyframes(), static_cast<int>(survey.truth.size()));
  const double before = errorsOf(reckonedOf(survey), survey.truth).aligned;
  const double after = errorsOf(posesOf(graph), survey.truth).aligned;
  EXPECT_LT(after, 0.1 * before) << before;
  EXPECT_LT(after, 0.02);
  EXPECT_EQ(graph.counters().links_contradicting, 0U);
  EXPECT_EQ(graph.counters().steps_contradicted, 0U);
}

TEST(NavigationGraph, ItsCovarianceIsHonestOverManySurveys) {
  // Sum of the NEES at a few poses of each survey; those of one survey hang together, surveys do not.
  MadeSurveyOptions options;
  options.lines = 3;
  options.line_length = 10;
  NavigationConfig config = smallConfig();
  config.noise = testing::madeNoise();
  constexpr int kSurveys = 40;
  double newest = 0, middle = 0, relative = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    const MadeSurvey survey = makeSurvey(options);
    NavigationGraph graph(config);
    drive(graph, survey, options);
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

TEST(NavigationGraph, DeadReckoningAloneIsHonestToo) {
  MadeSurveyOptions options;
  options.visual_share = 0;
  options.closure_share = 0;
  NavigationConfig config = smallConfig();
  config.noise = testing::madeNoise();
  constexpr int kSurveys = 40;
  double sum = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    const MadeSurvey survey = makeSurvey(options);
    NavigationGraph graph(config);
    drive(graph, survey, options);
    sum += nees(graph, survey, graph.keyframes() - 1);
  }
  EXPECT_GT(sum / kSurveys, 0.5 * 6);
  EXPECT_LT(sum / kSurveys, 1.5 * 6);
}

// RMS of the vertical error about its mean [m].
double verticalErrorOf(const NavigationGraph& graph, const MadeSurvey& survey) {
  double sum = 0, squares = 0;
  for (int k = 0; k < graph.keyframes(); ++k) {
    const double error =
        graph.pose(k).translation().z() - survey.truth[static_cast<std::size_t>(k)].translation().z();
    sum += error, squares += error * error;
  }
  const double mean = sum / graph.keyframes();
  return std::sqrt(squares / graph.keyframes() - mean * mean);
}

double secondsOf(const KeyframeInput& input) {
  return static_cast<double>(input.utc_ns) * 1e-9;
}

void sink(KeyframeInput& input, double by) {
  input.T_odom_cam =
      SE3(input.T_odom_cam.rotation(), input.T_odom_cam.translation() + Eigen::Vector3d(0, 0, by));
}

TEST(NavigationGraph, ATideThatNobodyPredictsGoesIntoTheDepthsReferenceAndNotIntoTheMap) {
  MadeSurveyOptions options;
  options.line_length = 35;
  MadeSurvey survey = makeSurvey(options);
  constexpr double kFastest = 4.2e-4;  // of 3 m of amplitude twice a day [m/s]
  for (KeyframeInput& input : survey.inputs) sink(input, kFastest * secondsOf(input));
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  const double risen = kFastest * secondsOf(survey.inputs.back());
  ASSERT_GT(risen, 0.1);
  EXPECT_EQ(graph.counters().links_contradicting, 0U);
  EXPECT_EQ(graph.counters().steps_contradicted, 0U);
  EXPECT_LT(verticalErrorOf(graph, survey), 0.012);  // of the tide itself: 0.036 m
  EXPECT_GT(graph.seaHeight(), 0.5 * risen);
}

TEST(NavigationGraph, SwellNeitherContradictsTheDvlNorMovesTheHeights) {
  MadeSurveyOptions options;
  options.visual_share = 0.7;
  MadeSurvey survey = makeSurvey(options);
  constexpr double kSwell = 0.38;  // amplitude [m]
  for (KeyframeInput& input : survey.inputs) {
    const double phase = 2 * M_PI * secondsOf(input) / 8;
    input.pressure_off = kSwell * std::sin(phase);
    input.pressure_sigma = kSwell / M_SQRT2;
    sink(input, 0.02 * input.pressure_off);  // what dead reckoning leaves of it
  }
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  EXPECT_EQ(graph.counters().links_contradicting, 0U);
  EXPECT_EQ(graph.counters().steps_contradicted, 0U);
  EXPECT_EQ(graph.counters().steps_left_out, 0U);
  EXPECT_LT(verticalErrorOf(graph, survey), 0.02);
}

TEST(NavigationGraph, FindsScaleAndMisalignmentOfTheDvl) {
  const MadeSurveyOptions options;
  for (const std::uint64_t seed : {3U, 4U, 5U}) {
    MadeSurveyOptions o = options;
    o.seed = seed;
    const MadeSurvey survey = makeSurvey(o);
    NavigationGraph graph(smallConfig());
    drive(graph, survey, o);
    EXPECT_NEAR(graph.dvl().scale(), -survey.dvl_scale, 4 * std::sqrt(graph.dvl().covariance()(0, 0)));
    EXPECT_NEAR(graph.dvl().heading(), survey.dvl_heading, 4 * std::sqrt(graph.dvl().covariance()(1, 1)));
    EXPECT_LT(graph.dvl().remainingShare(), 0.002);
    EXPECT_EQ(graph.dvl().restarts(), 0U);
  }
}

TEST(NavigationGraph, SurvivesADeadDvlAJumpingCompassAndWildFixes) {
  MadeSurveyOptions options;
  options.dvl_dead_from = 40;
  options.dvl_dead_to = 100;
  options.jump_at = 70;
  options.jump = 20 * 3.14159265 / 180;
  options.jump_told = false;
  options.wild_fixes = 0.1;
  options.usbl_period = 2;
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).aligned, 0.02);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).absolute, 0.5);
  const NavigationGraph::Counters& c = graph.counters();
  EXPECT_GE(c.dvl_absent, 59U);
  EXPECT_GE(c.steps_contradicted, 1U);
  EXPECT_GE(c.fixes_gated + c.fixes_off, 2U);
}

TEST(NavigationGraph, ADvlThatLiesIsNoticedAndTrustedAgainLater) {
  MadeSurveyOptions options;
  options.lie_from = 30;
  options.lie_to = 60;
  options.lie = 0.2;
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
  graph.setAnchor(survey.anchor, options.anchor_sigma);
  bool noticed = false;
  for (std::size_t k = 0; k < survey.inputs.size(); ++k) {
    ASSERT_TRUE(graph.addKeyframe(survey.inputs[k]));
    if (k > 0)
      (void)graph.addLink(LinkKind::kOdometry, static_cast<int>(k) - 1, static_cast<int>(k),
                          survey.visual[k - 1].T_a_b, survey.link_covariance);
    (void)graph.step();
    noticed = noticed || graph.counters().dvl_lies;
  }
  EXPECT_TRUE(noticed);
  EXPECT_FALSE(graph.counters().dvl_lies);
  EXPECT_GE(graph.counters().steps_left_out, 25U);
  EXPECT_LT(errorsOf(posesOf(graph), survey.truth).aligned, 0.1);
}

TEST(NavigationGraph, AFalseClosureIsTurnedAwayOrSwitchedOff) {
  const MadeSurveyOptions options;
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  const std::vector<SE3> before = posesOf(graph);
  const SE3 false_pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, 0, 0));
  EXPECT_EQ(graph.addLink(LinkKind::kClosure, 5, graph.keyframes() - 1, false_pose, survey.link_covariance),
            Taken::kContradicts);
  EXPECT_EQ(graph.counters().links_contradicting, 1U);
}

TEST(NavigationGraph, WhatContradictsIsSaidByHowFarItsOwnCovarianceIsBelieved) {
  const MadeSurveyOptions options;
  const MadeSurvey survey = makeSurvey(options);
  NavigationConfig config = smallConfig();
  config.known_scale = 1e9;
  NavigationGraph graph(config);
  drive(graph, survey, options);
  const SE3 false_pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3, 0, 0));
  EXPECT_EQ(graph.addLink(LinkKind::kClosure, 5, graph.keyframes() - 1, false_pose, survey.link_covariance),
            Taken::kYes);
  config.known_scale = 0.9;
  EXPECT_THROW(NavigationGraph{config}, std::invalid_argument);
}

TEST(NavigationGraph, AFalseClosureThatCameFirstIsSwitchedOffByTrueOnes) {
  MadeSurveyOptions options;
  options.visual_share = options.closure_share = 0;  // dead reckoning alone cannot tell
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
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
  EXPECT_GE(graph.counters().links_contradicting, 4U);
  EXPECT_EQ(graph.counters().links_off, 1U);
  const SE3 off = right.inverse() * graph.predict(older, last).T_a_b;
  EXPECT_LT(off.translation().norm(), 0.002);
}

TEST(NavigationGraph, TellsWhichKeyframesMovedTheFarthestFirst) {
  const MadeSurveyOptions options;
  const MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  ASSERT_GT(graph.changesWaiting(), 10U);
  std::size_t taken = 0;
  const std::size_t waiting = graph.changesWaiting();
  while (graph.takeChange()) ++taken;
  EXPECT_EQ(taken, waiting);
  EXPECT_EQ(graph.changesWaiting(), 0U);
}

TEST(NavigationGraph, SameCallsGiveTheSameBytes) {
  const MadeSurveyOptions options;
  const MadeSurvey survey = makeSurvey(options);
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
  EXPECT_EQ(graph.addFix(0, Eigen::Vector3d::Zero(), {0, 0}, -1), Taken::kBad);
  config.max_keyframes = 0;
  EXPECT_THROW(NavigationGraph{config}, std::invalid_argument);
}

}  // namespace
}  // namespace fathom::slam

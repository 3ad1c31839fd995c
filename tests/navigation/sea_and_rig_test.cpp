// Errors that have states of their own: the height of the sea, and the range error of the rig.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "recon/navigation/graph/navigation_graph.hpp"
#include "tests/world/dive.hpp"

namespace fathom::slam {
namespace {

using testing::drive, testing::driveOn, testing::makeDive, testing::smallConfig, testing::SyntheticDive;
using testing::SyntheticDiveOptions, testing::turnAll;

// RMS of the vertical error about its mean [m].
double verticalErrorOf(const NavigationGraph& graph, const SyntheticDive& survey) {
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

constexpr double kFastest = 4.2e-4;  // rate of a tide of 3 m of amplitude twice a day [m/s]

// With a tide in the depths that is not predicted.
SyntheticDive tidalSurvey(const SyntheticDiveOptions& options) {
  SyntheticDive survey = makeDive(options);
  for (KeyframeInput& input : survey.inputs) sink(input, kFastest * secondsOf(input));
  return survey;
}

TEST(NavigationGraph, ATideThatNobodyPredictsGoesIntoTheDepthsReferenceAndNotIntoTheMap) {
  SyntheticDiveOptions options{.line_length = 35};
  const SyntheticDive survey = tidalSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  const double risen = kFastest * secondsOf(survey.inputs.back());
  ASSERT_GT(risen, 0.1);
  EXPECT_EQ(graph.counters().links_contradicting, 0U);
  EXPECT_EQ(graph.counters().steps_contradicted, 0U);
  EXPECT_LT(verticalErrorOf(graph, survey), 0.012);  // of the tide itself: 0.036 m
  EXPECT_GT(graph.seaHeight(), 0.75 * risen);
}

// A line that crosses many others within a minute shows that the sea rose while they were flown, however
// gently their heights are biased; the vehicle's tilt, its bias turning with it, shows it too.
TEST(NavigationGraph, ATideDoesNotTiltTheMap) {
  SyntheticDiveOptions options{.lines = 12, .line_length = 12};
  const SyntheticDive survey = tidalSurvey(options);
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  // Slope of the vertical error over time, as a share of the tide's.
  double n = 0, t = 0, tt = 0, e = 0, te = 0;
  for (int k = 0; k < graph.keyframes(); ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double s = secondsOf(survey.inputs[i]),
                 off = graph.pose(k).translation().z() - survey.truth[i].translation().z();
    ++n, t += s, tt += s * s, e += off, te += s * off;
  }
  const double slope = (te - t * e / n) / (tt - t * t / n);
  EXPECT_LT(std::abs(slope), 0.14 * kFastest);
}

TEST(NavigationGraph, SwellNeitherContradictsTheDvlNorMovesTheHeights) {
  SyntheticDiveOptions options{.visual_share = 0.7};
  SyntheticDive survey = makeDive(options);
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
  EXPECT_LT(verticalErrorOf(graph, survey), 0.03);
}

// Swell of changing amplitude, and a tide that is predicted or not.
TEST(NavigationGraph, SwellMovesTheHeightsLessWhereTheTideIsPredicted) {
  constexpr double kSwell = 0.27, kKeeps = 0.9;  // standard deviation [m]; of a wave's sine, each second
  SyntheticDiveOptions options{.lines = 12, .line_length = 12};
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  double free = 0, predicted = 0;
  for (options.seed = 1; options.seed <= 4; ++options.seed) {
    SyntheticDive survey = makeDive(options);
    Eigen::Vector2d wave(0, 0);
    for (KeyframeInput& input : survey.inputs) {
      const double phase = 2 * M_PI * secondsOf(input) / 8, root = std::sqrt(1 - kKeeps * kKeeps);
      wave = kKeeps * wave + root * Eigen::Vector2d(normal(random), normal(random));
      input.pressure_off = kSwell * wave.dot(Eigen::Vector2d(std::sin(phase), std::cos(phase)));
      input.pressure_sigma = kSwell;
    }
    NavigationConfig config = smallConfig();
    NavigationGraph without(config);
    config.noise = withTide(config.noise, true);
    NavigationGraph with(config);
    drive(without, survey, options);
    drive(with, survey, options);
    free += std::pow(verticalErrorOf(without, survey), 2);
    predicted += std::pow(verticalErrorOf(with, survey), 2);
  }
  EXPECT_LT(std::sqrt(predicted / free), 0.85) << std::sqrt(free / 4);
}

// Visual odometry of a rig whose ranges are wrong by `longer`, from a keyframe on.
void lengthen(SyntheticDive& survey, double longer, int from) {
  for (SyntheticDive::Link& link : survey.visual)
    if (link.b >= from) link.T_a_b = SE3(link.T_a_b.rotation(), (1 + longer) * link.T_a_b.translation());
}

// A principal point that is wrong by a pixel makes all paths two percent too long: it is the rig's error, not
// the DVL's, which is known better.
TEST(NavigationGraph, ARigWhoseRangesAreWrongLeavesARightDvlAsItIs) {
  for (const double longer : {0.02, -0.02}) {
    SyntheticDiveOptions options{.seed = 6};
    SyntheticDive survey = makeDive(options);
    lengthen(survey, longer, 0);
    NavigationGraph graph(smallConfig());
    drive(graph, survey, options);
    EXPECT_NEAR(graph.dvl().scale(), -survey.dvl_scale, 0.004);
    const Eigen::Vector2d error = graph.dvl().rangeError();
    EXPECT_NEAR(error.x() + error.y() * KeyframeInput().range, longer, 0.005);
    EXPECT_EQ(graph.dvl().restarts(), 0U);
    EXPECT_FALSE(graph.counters().dvl_rejected);
  }
}

TEST(NavigationGraph, AKnockedRigIsNotTakenForADvlThatFails) {
  SyntheticDiveOptions options{.seed = 7};
  SyntheticDive survey = makeDive(options);
  constexpr int kKnocked = 60, kMeasured = 68;
  lengthen(survey, 0.5, kKnocked);
  NavigationGraph graph(smallConfig());
  graph.setAnchor(survey.anchor, options.anchor_sigma);
  driveOn(graph, survey, options, kMeasured);
  ASSERT_TRUE(graph.counters().dvl_rejected) << "not yet known which of the two";
  graph.resetRig(1e-4, survey.inputs[kKnocked].utc_ns, true);
  EXPECT_FALSE(graph.counters().dvl_rejected);
  EXPECT_EQ(graph.counters().steps_left_out, 0U);
  EXPECT_GE(graph.counters().visual_rejected, static_cast<std::uint64_t>(kMeasured - kKnocked - 1));
}

// By a camera whose image's y axis is the body's x axis.
SyntheticDive alongItsImage(const SyntheticDiveOptions& options) {
  return testing::mounted(makeDive(options),
                          Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ())));
}

// A disparity that slopes along the baseline makes images yaw by 1 mrad as a metre of ground passes, on every
// line to the same side: closures between lines show it, and the links that come are without it.
TEST(SeaAndRig, AYawThatAllStepsShareIsShownByClosures) {
  constexpr double kSpin = 1e-3;  // [rad/m]
  SyntheticDiveOptions options{.lines = 10};
  SyntheticDive survey = alongItsImage(options);
  NavigationGraph straight(smallConfig());
  drive(straight, survey, options);
  turnAll(survey, testing::curvedBy(0, 0, 0, kSpin));
  NavigationGraph graph(smallConfig());
  drive(graph, survey, options);
  EXPECT_NEAR(straight.dvl().curl()(3), 0, 4e-5);
  EXPECT_NEAR(graph.dvl().curl()(3), kSpin, 7e-5);
  EXPECT_LT(graph.dvl().curlSigma()(3), 2e-4);
}

// Until something shows it, what images' turns have in common is claimed: without closures the compass alone
// measures the yaw, and nothing a curve of ranges across the lines.
TEST(SeaAndRig, WhatAllStepsTurnByIsClaimedWhereNothingShowsIt) {
  SyntheticDiveOptions options{.lines = 3, .line_length = 12, .closure_share = 0};
  NavigationConfig config = smallConfig();
  config.noise = testing::syntheticNoise();
  std::normal_distribution<double> normal;
  std::mt19937_64 random(5);
  constexpr int kSurveys = 40;
  double squared = 0, heading = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    SyntheticDive survey = alongItsImage(options);
    const auto drawn = [&](double sigma) { return sigma * normal(random); };
    const double curl = config.rig.curl;
    turnAll(survey, testing::curvedBy(drawn(curl), drawn(curl), drawn(curl), drawn(config.rig.spin)));
    NavigationGraph graph(config);
    drive(graph, survey, options);
    const int last = graph.keyframes() - 1;
    const UncertainPose seen = graph.predict(0, last);
    const SE3 truth = survey.truth.front().inverse() * survey.truth.back();
    squared += testing::squaredError(seen.T_a_b, truth, seen.covariance) / kSurveys;
    const double yaw = (seen.T_a_b.inverse() * truth).log()(5);
    heading += yaw * yaw / seen.covariance(5, 5) / kSurveys;
  }
  // 95 % of chi-square with 240 and 40 degrees of freedom, over 40.
  EXPECT_LT(squared, 7.12);
  EXPECT_GT(squared, 4.97);
  EXPECT_LT(heading, 1.48);
  EXPECT_GT(heading, 0.61);
}

// Ranges that are curved across the lines, which steps along them do not show: closures with the lines beside
// do, by what is known of the attitudes.
TEST(SeaAndRig, RangesThatAreCurvedAcrossTheLinesAreShownByClosures) {
  constexpr double kCurl = 8e-3;  // [rad/m]
  constexpr int kSurveys = 4;
  SyntheticDiveOptions options{.lines = 10, .closure_share = 1};
  double mean = 0;
  for (options.seed = 1; options.seed <= kSurveys; ++options.seed) {
    SyntheticDive survey = alongItsImage(options);
    turnAll(survey, testing::curvedBy(kCurl, 0, 0, 0));
    NavigationGraph graph(smallConfig());
    drive(graph, survey, options);
    EXPECT_NEAR(graph.dvl().curl()(0), kCurl, 3 * graph.dvl().curlSigma()(0)) << options.seed;
    EXPECT_LT(graph.dvl().curlSigma()(0), 2e-3);
    mean += graph.dvl().curl()(0) / kSurveys;
  }
  EXPECT_NEAR(mean, kCurl, 1e-3);
}

// Steps see another curve than closures do, whose images overlap less: a survey in swell, which depths hold
// little, is not bent by it.
TEST(SeaAndRig, ACurveThatClosuresDoNotShowBendsNoSurvey) {
  constexpr double kCurl = -4e-3, kSwell = 0.3;  // [rad/m]; standard deviation [m]
  constexpr int kSurveys = 3;
  SyntheticDiveOptions options{.lines = 40, .line_length = 10, .reach = 1.3};
  NavigationConfig config = smallConfig();
  config.max_keyframes = 1600;
  std::normal_distribution<double> normal;
  std::mt19937_64 random(7);
  double squared = 0;
  for (options.seed = 1; options.seed <= kSurveys; ++options.seed) {
    SyntheticDive survey = alongItsImage(options);
    const std::vector<SyntheticDive::Link> closures = survey.closures;
    turnAll(survey, testing::curvedBy(kCurl, 0, 0, 0));
    survey.closures = closures;
    for (KeyframeInput& input : survey.inputs) {
      input.pressure_off = kSwell * normal(random);
      input.pressure_sigma = kSwell;
    }
    NavigationGraph graph(config);
    drive(graph, survey, options);
    squared += std::pow(verticalErrorOf(graph, survey), 2) / kSurveys;
    // Closures that were replaced have left their places.
    const IncrementalSolver& solver = graph.solver();
    int off = 0;
    for (int k = 0; k < solver.measurements(); ++k)
      off += solver.measurement(k).in_use && solver.measurement(k).weight == 0 ? 1 : 0;
    EXPECT_LT(off, 12);
  }
  EXPECT_LT(std::sqrt(squared), 0.025);
}

}  // namespace
}  // namespace fathom::slam

#include "recon/navigation/graph/navigation_batch.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <stdexcept>

#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/batch/graph_covariance.hpp"
#include "tests/world/dive.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

using testing::errorsOf, testing::makeDive, testing::Measured, testing::measuredOf, testing::squaredError;
using testing::SyntheticDive, testing::SyntheticDiveOptions;

NavigationSolution solve(const SyntheticDive& survey, const SyntheticDiveOptions& options, Measured& measured,
                         const NavigationConfig& config = {}) {
  return solveNavigation(config, survey.inputs, survey.anchor, options.anchor_sigma, measured.links,
                         measured.fixes);
}

TEST(NavigationBatch, IsAsGoodAsTheTrueClosuresAllow) {
  const SyntheticDiveOptions options;
  const SyntheticDive survey = makeDive(options);
  Measured measured = measuredOf(survey, options.usbl_sigma);
  const NavigationSolution solved = solve(survey, options, measured);
  ASSERT_EQ(solved.poses.size(), survey.truth.size());
  std::vector<SE3> reckoned;
  for (const KeyframeInput& input : survey.inputs) reckoned.push_back(input.T_odom_cam);
  EXPECT_LT(errorsOf(solved.poses, survey.truth).aligned, 0.1 * errorsOf(reckoned, survey.truth).aligned);
  std::size_t lost = 0;
  for (const NavigationLink& link : measured.links) lost += link.kept ? 0 : 1;
  EXPECT_LE(lost, 2U);  // 99.9 % stay
}

TEST(NavigationBatch, ItsCovarianceIsConsistentOverManySurveys) {
  SyntheticDiveOptions options{.lines = 3, .line_length = 10};
  NavigationConfig config;
  config.noise = testing::syntheticNoise();
  constexpr int kSurveys = 40;
  double newest = 0, between = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(100 + seed);
    const SyntheticDive survey = makeDive(options);
    Measured measured = measuredOf(survey, options.usbl_sigma);
    for (NavigationFix& fix : measured.fixes) fix.by_usbl = false;  // these share no error
    const NavigationSolution solved = solve(survey, options, measured, config);
    GraphCovariance covariance(solved.graph);
    const std::size_t last = solved.poses.size() - 1, first = last / 3;
    newest += squaredError(solved.poses[last], survey.truth[last], covariance.of(solved.nodes[last]));
    between += squaredError(solved.poses[first].inverse() * solved.poses[last],
                            survey.truth[first].inverse() * survey.truth[last],
                            covariance.between(solved.nodes[first], solved.nodes[last]));
  }
  // 95 % of chi-square with 240 degrees of freedom, over 40.
  for (const double sum : {newest, between}) {
    EXPECT_GT(sum / kSurveys, 4.97);
    EXPECT_LT(sum / kSurveys, 7.12);
  }
}

TEST(NavigationBatch, MarginalCovariancesAreThoseOfTheWholeInverse) {
  SyntheticDiveOptions options{.lines = 2, .line_length = 8};
  const SyntheticDive survey = makeDive(options);
  Measured measured = measuredOf(survey, options.usbl_sigma);
  const NavigationSolution solved = solve(survey, options, measured);
  const Eigen::MatrixXd dense = covarianceOf(solved.graph.poses, solved.graph.edges);
  GraphCovariance covariance(solved.graph);
  const int a = solved.nodes[solved.nodes.size() / 3], b = solved.nodes.back();
  const Eigen::MatrixXd both = jointOf(dense, a, b);
  const Matrix6d own = both.bottomRightCorner<6, 6>();
  EXPECT_LT((covariance.of(b) - own).norm(), 1e-4 * own.norm());
  // T_a_b = T_a^-1 T_b: its right perturbation is that of b less that of a, seen from b.
  const SE3 T_b_a = solved.graph.poses[static_cast<std::size_t>(b)].inverse() *
                    solved.graph.poses[static_cast<std::size_t>(a)];
  Eigen::Matrix<double, 6, 12> J;
  J << -adjoint(T_b_a), Matrix6d::Identity();
  const Matrix6d between = J * both * J.transpose();
  EXPECT_LT((covariance.between(a, b) - between).norm(), 1e-3 * between.norm());
}

TEST(NavigationBatch, FindsWhatAllPositionsOfAUsblShare) {
  SyntheticDiveOptions options{.lines = 6, .line_length = 60};
  options.anchor_sigma = 0.1;  // by GPS
  options.ship = {80, -40};
  options.usbl_turn = 0.05;
  NavigationConfig config;
  config.noise = testing::syntheticNoise();
  config.noise.usbl_shift = 5;
  config.noise.usbl_turn = 0.1;
  double worst = 0, as_given = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    options.seed = seed;
    const SyntheticDive survey = makeDive(options);
    Measured measured = measuredOf(survey, options.usbl_sigma);
    const NavigationSolution with = solveNavigation(config, survey.inputs, survey.anchor,
                                                    options.anchor_sigma, measured.links, measured.fixes);
    ASSERT_GE(with.usbl_node, 0);
    const SE3 found = with.graph.poses[static_cast<std::size_t>(with.usbl_node)];
    const double sigma = std::sqrt(GraphCovariance(with.graph).of(with.usbl_node)(5, 5));
    EXPECT_NEAR(found.euler().z(), -options.usbl_turn, 3 * sigma);
    EXPECT_LT(sigma, 0.02);
    worst = std::max(worst, errorsOf(with.poses, survey.truth).absolute);
    for (NavigationFix& fix : measured.fixes) fix.by_usbl = false;
    as_given += errorsOf(solve(survey, options, measured).poses, survey.truth).absolute / 5;
  }
  EXPECT_LT(worst, 0.4 * as_given);
}

// A survey of a few metres, in whose middle a reflection moves the positions by half a metre.
TEST(NavigationBatch, AReflectionDoesNotTurnASmallSurvey) {
  SyntheticDiveOptions options{
      .lines = 4, .line_length = 3, .usbl_sigma = 0.15, .usbl_period = 2, .bias_from = 14};
  NavigationConfig config;
  config.noise = testing::syntheticNoise();
  options.bias = {0.5, 0.25};
  constexpr int kSurveys = 12;
  double squares = 0;
  for (int seed = 1; seed <= kSurveys; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    const SyntheticDive survey = makeDive(options);
    Measured measured = measuredOf(survey, options.usbl_sigma);
    for (NavigationFix& fix : measured.fixes)
      fix.sigma = usblSigma(fix.sigma, options.usbl_period, config.noise);
    const NavigationSolution solved = solve(survey, options, measured, config);
    const std::size_t middle = solved.poses.size() / 2;
    const double off = (solved.poses[middle] * survey.truth[middle].inverse()).euler().z(),
                 sigma = std::sqrt(GraphCovariance(solved.graph).of(solved.nodes[middle])(5, 5));
    squares += off * off / (sigma * sigma);
  }
  EXPECT_LT(std::sqrt(squares / kSurveys), 1.8);  // 2.4 if each erred by itself
}

// Before anything is solved: of a usual vehicle little more than its data sheets say.
TEST(NavigationBatch, StepsThatImagesConfirmShowTheSensorsNoise) {
  const SyntheticDive usual = makeDive({});
  const auto seen = [](const SyntheticDive& survey) {
    return noiseBySteps({}, survey.inputs, measuredOf(survey, 0.5).links, Eigen::Vector3d::Zero());
  };
  const SensorNoise given, calm = seen(usual);
  EXPECT_LT(calm.heading, 2 * given.heading);
  EXPECT_LT(calm.tilt, 2 * given.tilt);
  EXPECT_LT(calm.dvl_velocity, 7 * given.dvl_velocity);
  SyntheticDive bad = usual;
  std::mt19937 random(3);
  std::normal_distribution<double> error(0, 1);
  for (KeyframeInput& input : bad.inputs) {
    Vector6d off;
    off << 0.05 * error(random), 0.05 * error(random), 0, 0.02 * error(random), 0.02 * error(random),
        0.06 * error(random);
    input.T_odom_cam = input.T_odom_cam * SE3::exp(off);
  }
  const SensorNoise wild = seen(bad);
  EXPECT_NEAR(wild.heading, 0.06, 0.02);
  EXPECT_NEAR(wild.tilt, 0.02, 0.007);
  EXPECT_GT(wild.dvl_velocity, 2 * calm.dvl_velocity);
}

TEST(NavigationBatch, WhatReadingsShareIsAsLargeAsTheyAreSeenToDiffer) {
  SyntheticDiveOptions options{.visual_share = 1};
  const auto seen = [&](const SyntheticDive& survey) {
    Measured measured = measuredOf(survey, options.usbl_sigma);
    SensorNoise noise{.usbl_shift = 0.1};  // below what is seen
    return adaptedNoise(noise, survey.inputs, measured.fixes, solve(survey, options, measured));
  };
  const SensorNoise usual, calm = seen(makeDive(options));
  EXPECT_LT(calm.deviation, 1.5 * usual.deviation);
  EXPECT_LT(calm.tilt_bias, 1.2 * usual.tilt_bias);
  EXPECT_LT(calm.heading, 1.5 * usual.heading);
  EXPECT_LT(calm.tilt, 1.5 * usual.tilt);
  // With the anchor's error, which is as large.
  EXPECT_GT(calm.usbl_shift, 0.5 * options.usbl_sigma);
  EXPECT_LT(calm.usbl_shift, 2 * options.usbl_sigma);
  // Four of ten positions agree with each other 8 m from where they should be.
  SyntheticDive biased = makeDive(options);
  for (std::size_t k = 0; k < biased.fixes.size(); ++k)
    if (10 * k >= 6 * biased.fixes.size()) biased.fixes[k].north_east.x() += 8;
  EXPECT_NEAR(seen(biased).usbl_shift, 8 / 1.665, 1);
  // A compass that turns by 20 degrees on every second line, and tilt that swings.
  SyntheticDive turned = makeDive(options);
  for (std::size_t k = 0; k < turned.inputs.size(); ++k) {
    SE3& pose = turned.inputs[k].T_odom_cam;
    const double tilt = k % 2 == 0 ? 0.02 : -0.02;
    pose = SE3(Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()) * pose.rotation(), pose.translation());
  }
  EXPECT_GT(seen(turned).tilt, 0.01);
}

TEST(NavigationBatch, TakesOutFalseClosuresAndWildFixesAndKeepsTheTrueOnes) {
  SyntheticDiveOptions options{.usbl_period = 4};
  const SyntheticDive survey = makeDive(options);
  Measured clean = measuredOf(survey, options.usbl_sigma), dirty = clean;
  const std::vector<SE3> right = solve(survey, options, clean).poses;
  const std::size_t true_links = dirty.links.size(), good_fixes = dirty.fixes.size();
  for (std::uint32_t k = 0; k < 4; ++k) {
    NavigationLink wrong = dirty.links.back();
    wrong.a = 5 + k;
    wrong.b = 60 + 9 * k;
    wrong.T_a_b = survey.truth[wrong.a].inverse() * survey.truth[wrong.b] *
                  SE3::fromEuler(0, 0, 0.1, {0.4, -0.3, 0.05});
    dirty.links.push_back(wrong);
    NavigationFix wild = dirty.fixes[k];
    wild.north_east += Eigen::Vector2d(9, -6);
    dirty.fixes.push_back(wild);
  }
  const std::vector<SE3> solved = solve(survey, options, dirty).poses;
  for (std::size_t i = true_links; i < dirty.links.size(); ++i) EXPECT_FALSE(dirty.links[i].kept) << i;
  for (std::size_t i = good_fixes; i < dirty.fixes.size(); ++i) EXPECT_FALSE(dirty.fixes[i].kept) << i;
  EXPECT_LT(errorsOf(solved, right).absolute, 0.005);
}

// Of those that the others contradict, chance has few, and false closures of few features many.
TEST(NavigationBatch, DoubtsAClosureOfFewFeaturesSooner) {
  const SyntheticDiveOptions options;
  const SyntheticDive survey = makeDive(options);
  const auto keptWith = [&](int features, double sigmas) {
    Measured measured = measuredOf(survey, options.usbl_sigma);
    for (NavigationLink& link : measured.links) link.inliers = 50;
    NavigationLink& off = measured.links[survey.visual.size() + survey.closures.size() / 2];
    off.inliers = features;
    off.T_a_b = survey.truth[off.a].inverse() * survey.truth[off.b] *
                SE3(Eigen::Quaterniond::Identity(), {sigmas * std::sqrt(off.covariance(0, 0)), 0, 0});
    (void)solve(survey, options, measured);
    return off.kept;
  };
  EXPECT_TRUE(keptWith(50, 7));
  EXPECT_FALSE(keptWith(38, 5));
  EXPECT_TRUE(keptWith(38, 3));
}

// The compass leaps while the DVL is dead, which visual odometry alone shows [s], [rad].
SyntheticDiveOptions leapWithoutBottomTrack(double dead_to, double jump_at, double jump) {
  SyntheticDiveOptions options{
      .dvl_dead_from = 40, .dvl_dead_to = dead_to, .jump_at = jump_at, .jump = jump, .jump_known = false};
  return options;
}

TEST(NavigationBatch, BridgesADeadDvlAndALeapOfTheCompass) {
  const SyntheticDiveOptions options = leapWithoutBottomTrack(100, 70, 0.35);
  const SyntheticDive survey = makeDive(options);
  Measured measured = measuredOf(survey, options.usbl_sigma);
  const NavigationSolution solved = solve(survey, options, measured);
  EXPECT_LT(errorsOf(solved.poses, survey.truth).aligned, 0.02);
  EXPECT_EQ(solved.sensors.compass_jumps, 1U);
}

// A leap small enough for a link to be wrong by, without a DVL that confirms the link.
TEST(NavigationBatch, ASmallLeapWithoutBottomTrackIsTheCompasssWhereTheLinkIsConfirmed) {
  const SyntheticDiveOptions options = leapWithoutBottomTrack(55, 50, 0.075);
  const SyntheticDive survey = makeDive(options);
  Measured measured = measuredOf(survey, options.usbl_sigma);
  for (NavigationLink& link : measured.links) {
    const SE3 reckoned = survey.inputs[link.a].T_odom_cam.inverse() * survey.inputs[link.b].T_odom_cam;
    link.confirmed = reckoned.rotation().angularDistance(link.T_a_b.rotation()) > 0.5 * options.jump;
  }
  const NavigationSolution solved = solve(survey, options, measured);
  EXPECT_LT(errorsOf(solved.poses, survey.truth).aligned, 0.02);
  EXPECT_EQ(solved.sensors.compass_jumps, 1U);
  EXPECT_EQ(solved.sensors.visual_rejected, 0U);
}

// Its heading was measured by a gyro to 0.2 mrad; a false link has turned it on its side.
TEST(NavigationBatch, APoseWhoseAttitudeDoesNotCountRightsItself) {
  const SensorNoise noise;
  constexpr double kHeading = 2e-4, kTilt = 0.02, kUncounted = 1e-4;  // [rad], [rad], of the information
  const Eigen::Vector3d dvl(0.1, -0.7, 0.05);
  PoseGraph graph;
  graph.poses.emplace_back();
  for (int k = 1; k <= 3; ++k) {
    const SE3 pose = SE3::fromEuler(0.1, -0.08, 0.2 * k, {0.25 * k, 0, 10});
    RelativePose& attitude = graph.edges.emplace_back(attitudeFactor(0, k, pose, noise));
    if (k == 2) attitude.information *= kUncounted;
    graph.edges.push_back(depthFactor(0, k, pose, noise.depth));
    if (k > 1) {
      const SE3& before = graph.poses.back();
      graph.edges.push_back(stepFactor(k - 1, k, before, pose, dvl, StepQuality{0.5}, noise));
      graph.edges.push_back(gyroFactor(k - 1, k, before, pose, 0, kHeading, kTilt));
    }
    graph.poses.push_back(pose);
  }
  graph.edges.push_back(
      fixFactor(0, 1, graph.poses[1], graph.poses[1], graph.poses[1].translation(), {0.25, 0}, 1));
  const SE3 right = graph.poses[2];
  for (const Eigen::Vector3d& axis : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0.6, -0.8, 0)}) {
    graph.poses[2] = SE3(Eigen::AngleAxisd(1.3, axis) * right.rotation(), right.translation());
    (void)optimize(graph, {.chordal = false});
    EXPECT_LT(graph.poses[2].rotation().angularDistance(right.rotation()), 1e-3);
    graph.poses[2] = right;
  }
}

TEST(NavigationBatch, WithoutLinksDeadReckoningStays) {
  SyntheticDiveOptions options;
  options.visual_share = options.closure_share = 0;
  options.usbl_period = 1e9;
  const SyntheticDive survey = makeDive(options);
  Measured none;
  const NavigationSolution solved = solve(survey, options, none);
  std::vector<SE3> reckoned;
  for (const KeyframeInput& input : survey.inputs)
    reckoned.emplace_back(
        input.T_odom_cam.rotation(),
        input.T_odom_cam.translation() + Eigen::Vector3d(survey.anchor.x(), survey.anchor.y(), 0));
  // Only the noise of single headings is smoothed.
  EXPECT_LT(errorsOf(solved.poses, reckoned).absolute, 0.1);
  EXPECT_TRUE(solveNavigation({}, {}, {0, 0}, 1, none.links, none.fixes).poses.empty());
  none.links.resize(1);
  none.links[0].b = 100000;
  EXPECT_THROW((void)solve(survey, options, none), std::invalid_argument);
}

}  // namespace
}  // namespace fathom::slam

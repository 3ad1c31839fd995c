#include <gtest/gtest.h>

#include "tests/slam/hostile_dives.hpp"

namespace fathom::slam {
namespace {

using testing::hostileDives;
using testing::runHostile;

// fathom-report hostile runs twenty seeds of each.
TEST(NavigationTrust, NoLieOfOneSensorTakesThePositionAway) {
  constexpr double kTwice = 2, kLost = 10;
  for (const auto& dive : hostileDives()) {
    const auto [lied_to, told] = runHostile(dive, 21);
    SCOPED_TRACE(dive.name);
    EXPECT_LT(lied_to.live, kLost);
    EXPECT_LT(lied_to.after, kTwice * told.after);
    EXPECT_LT(lied_to.topside, kTwice * told.topside);
  }
}

TEST(NavigationTrust, RandomClosuresStayOutHoweverManyComeInARow) {
  testing::MadeSurveyOptions options;
  const testing::MadeSurvey survey = makeSurvey(options);
  NavigationGraph graph(testing::smallConfig());
  drive(graph, survey, options);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> metres(-3, 3), radians(-3, 3);
  for (int i = 0; i < 40; ++i) {
    const SE3 wrong = SE3::fromEuler(0, 0, radians(random), {metres(random), metres(random), 0});
    EXPECT_EQ(
        graph.addLink(LinkKind::kClosure, 3 + i, graph.keyframes() - 1 - i, wrong, survey.link_covariance),
        Taken::kContradicts);
    (void)graph.step();
  }
}

TEST(NavigationTrust, AFixThatFitsEndsTheInsistenceOfWildOnes) {
  testing::MadeSurveyOptions options;
  options.usbl_period = 1e9;
  const testing::MadeSurvey survey = makeSurvey(options);
  NavigationConfig config = testing::smallConfig();
  config.max_fixes = 400;
  NavigationGraph graph(config);
  drive(graph, survey, options);
  for (int i = 0; i < 60; ++i) {
    const int k = 20 + i;
    const auto at = static_cast<std::size_t>(k);
    const Eigen::Vector2d place = survey.truth[at].translation().head<2>();
    const Eigen::Vector2d wild = place + (i % 6 == 5 ? Eigen::Vector2d(0, 0) : Eigen::Vector2d(8, 0));
    const Taken taken = graph.addFix(k, survey.inputs[at].T_odom_cam.translation(), wild, 0.5, false);
    EXPECT_EQ(taken, i % 6 == 5 ? Taken::kYes : Taken::kContradicts) << i;
  }
}

}  // namespace
}  // namespace fathom::slam

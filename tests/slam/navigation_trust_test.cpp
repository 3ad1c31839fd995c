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

// Of places that are level against the first [m].
double rmsOf(const NavigationGraph& graph, const testing::MadeSurvey& survey) {
  double sum = 0;
  for (int k = 0; k < graph.keyframes(); ++k)
    sum += (graph.pose(k).translation() - graph.pose(0).translation() -
            (survey.truth[static_cast<std::size_t>(k)].translation() - survey.truth[0].translation()))
               .head<2>()
               .squaredNorm();
  return std::sqrt(sum / graph.keyframes());
}

TEST(NavigationTrust, JudgesTheStepsOfACameraThatLooksAheadAsThoseOfOneThatLooksDown) {
  testing::MadeSurveyOptions options;
  options.lines = 6;
  const testing::MadeSurvey down = makeSurvey(options);
  NavigationGraph reference(testing::smallConfig());
  drive(reference, down, options);
  for (const double degrees : {45.0, 90.0})
    for (const Eigen::Vector3d& axis : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0)}) {
      const Eigen::Quaterniond R(Eigen::AngleAxisd(degrees * M_PI / 180, axis));
      NavigationConfig config = testing::smallConfig();
      config.forward_in_camera = R.conjugate() * kForward;
      NavigationGraph graph(config);
      drive(graph, testing::mounted(down, R), options);
      SCOPED_TRACE(degrees);
      const NavigationGraph::Counters &c = graph.counters(), &r = reference.counters();
      EXPECT_EQ(c.steps_contradicted, r.steps_contradicted);
      EXPECT_EQ(c.steps_left_out, r.steps_left_out);
      EXPECT_EQ(c.visual_distrusted, r.visual_distrusted);
      EXPECT_EQ(c.compass_distrusted, r.compass_distrusted);
      EXPECT_EQ(c.closures, r.closures);
      EXPECT_EQ(c.references, r.references);
      // What images share by curved ranges is the camera's, and so each mounting's own.
      EXPECT_LT(rmsOf(graph, down), 1.05 * rmsOf(reference, down)) << axis.transpose();
    }
}

}  // namespace
}  // namespace fathom::slam

#include <gtest/gtest.h>

#include "tests/slam/hostile_dives.hpp"

namespace fathom::slam {
namespace {

using testing::errorsOf;
using testing::hostileDives;
using testing::posesOf;
using testing::runHostile;

// As the vehicle does where it knows better what all links share.
void renewAll(NavigationGraph& graph, const testing::MadeSurvey& survey) {
  for (const auto& link : survey.visual) graph.renewOdometry(link.b, link.T_a_b, survey.link_covariance);
  for (int i = 0; i < 30; ++i) (void)graph.step();
}

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

TEST(NavigationTrust, JudgesTheStepsOfACameraThatLooksAheadAsThoseOfOneThatLooksDown) {
  testing::MadeSurveyOptions options;
  options.lines = 6;
  testing::MadeSurvey down = makeSurvey(options);
  for (const bool closures : {true, false}) {
    if (!closures) down.closures.clear();
    NavigationGraph reference(testing::smallConfig());
    drive(reference, down, options);
    renewAll(reference, down);
    const double least = errorsOf(posesOf(reference), down.truth).aligned;
    for (const double degrees : {45.0, 90.0})
      for (const Eigen::Vector3d& axis : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0)}) {
        const Eigen::Quaterniond R(Eigen::AngleAxisd(degrees * M_PI / 180, axis));
        const testing::MadeSurvey survey = testing::mounted(down, R);
        NavigationConfig config = testing::smallConfig();
        config.forward_in_camera = R.conjugate() * kForward;
        NavigationGraph graph(config);
        drive(graph, survey, options);
        renewAll(graph, survey);
        SCOPED_TRACE(degrees);
        const NavigationGraph::Counters &c = graph.counters(), &r = reference.counters();
        EXPECT_EQ(c.steps_contradicted, r.steps_contradicted);
        EXPECT_EQ(c.steps_left_out, r.steps_left_out);
        EXPECT_EQ(c.visual_distrusted, r.visual_distrusted);
        EXPECT_EQ(c.compass_distrusted, r.compass_distrusted);
        EXPECT_EQ(c.closures, r.closures);
        EXPECT_EQ(c.references, r.references);
        // What images share by curved ranges is the camera's, and so each mounting's own. A yaw by them is
        // told by closures (9.3 to 10.8 mm, 10.2 of one that looks down), or by the compass (57 to 72, 55).
        EXPECT_LT(errorsOf(posesOf(graph), down.truth).aligned, (closures ? 1.1 : 1.4) * least)
            << axis.transpose();
      }
  }
}

}  // namespace
}  // namespace fathom::slam

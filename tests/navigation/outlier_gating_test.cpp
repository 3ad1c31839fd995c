#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "tests/navigation/hostile_dives.hpp"

namespace fathom::slam {
namespace {

using testing::errorsOf;
using testing::hostileDives;
using testing::posesOf;
using testing::runHostile;

// As the vehicle does when the estimate of what all links share has changed.
void renewAll(NavigationGraph& graph, const testing::SyntheticDive& survey) {
  for (const auto& link : survey.visual) graph.renewOdometry(link.b, link.T_a_b, survey.link_covariance);
  for (int i = 0; i < 30; ++i) (void)graph.step();
}

// fathom-report hostile runs twenty seeds of each.
TEST(OutlierGating, OutliersOfOneSensorDoNotMoveThePosition) {
  constexpr double kMostRatio = 2, kLost_m = 10;
  for (const auto& dive : hostileDives()) {
    const auto [all, clean] = runHostile(dive, 21);
    SCOPED_TRACE(dive.name);
    EXPECT_LT(all.live, kLost_m);
    EXPECT_LT(all.after, kMostRatio * clean.after);
    EXPECT_LT(all.topside, kMostRatio * clean.topside);
  }
}

TEST(OutlierGating, RandomClosuresStayOutHoweverManyComeInARow) {
  testing::SyntheticDiveOptions options;
  const testing::SyntheticDive survey = makeDive(options);
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

TEST(OutlierGating, AFixInsideTheGateEndsARunOfRejectedOnes) {
  testing::SyntheticDiveOptions options;
  options.usbl_period = 1e9;
  const testing::SyntheticDive survey = makeDive(options);
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

// In a turn the compass lags by a degree, twenty standard deviations of visual odometry.
TEST(OutlierGating, AKeyframeBeginsWhereImagesSawIt) {
  const testing::SyntheticDiveOptions options;
  const testing::SyntheticDive survey = makeDive(options);
  NavigationGraph graph(testing::smallConfig());
  constexpr int kNewest = 40;
  driveOn(graph, survey, options, kNewest);
  KeyframeInput turned = survey.inputs[kNewest];
  turned.T_odom_cam = SE3(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitZ()) * turned.T_odom_cam.rotation(),
                          turned.T_odom_cam.translation());
  ASSERT_EQ(graph.addKeyframe(turned), kNewest);
  const SE3& T_a_b = survey.visual[kNewest - 1].T_a_b;
  (void)graph.addLink(LinkKind::kOdometry, kNewest - 1, kNewest, T_a_b, survey.link_covariance);
  graph.judge();
  ASSERT_TRUE(graph.visualInlier(kNewest));
  const SE3 off = (graph.pose(kNewest - 1) * T_a_b).inverse() * graph.pose(kNewest);
  EXPECT_LT(off.log().norm(), 3e-3);  // standard deviation of the turn that all links share: 2 mrad
}

// Images that saw level ground curved, as a calibration may leave it, are turned along each mounting's own
// axes: closures show it, and without them the compass alone.
TEST(OutlierGating, JudgesTheStepsOfACameraThatLooksAheadAsThoseOfOneThatLooksDown) {
  testing::SyntheticDiveOptions options;
  options.lines = 6;
  const RigPrior rig;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  std::array<Eigen::Quaterniond, 4> mountings;
  for (std::size_t m = 0; m < mountings.size(); ++m)
    mountings[m] = Eigen::AngleAxisd(m / 2 == 0 ? M_PI / 4 : M_PI / 2, Eigen::Vector3d::Unit(m % 2));
  struct Case {
    bool closures, curved;
    int surveys;
    double within;  // times the error of a camera that looks down
  };
  for (const Case& c : {Case{true, false, 1, 1.1}, Case{true, true, 4, 1.4}, Case{false, true, 4, 1.8},
                        Case{false, false, 4, 1.8}}) {
    double least = 0;
    std::array<double, mountings.size()> errors{};
    for (options.seed = 1; options.seed <= static_cast<std::uint64_t>(c.surveys); ++options.seed) {
      const auto drawn = [&](double sigma) { return sigma * normal(random); };
      const Eigen::Matrix3d curved =
          testing::curvedBy(drawn(rig.curl), drawn(rig.curl), drawn(rig.curl), drawn(rig.spin));
      testing::SyntheticDive straight = makeDive(options), down = straight;
      if (!c.closures) straight.closures.clear(), down.closures.clear();
      if (c.curved) turnAll(down, curved);
      NavigationGraph reference(testing::smallConfig());
      drive(reference, down, options);
      renewAll(reference, down);
      least += std::pow(errorsOf(posesOf(reference), down.truth).aligned, 2);
      for (std::size_t m = 0; m < mountings.size(); ++m) {
        SCOPED_TRACE(m);
        testing::SyntheticDive survey = testing::mounted(straight, mountings[m]);
        if (c.curved) turnAll(survey, curved);
        NavigationConfig config = testing::smallConfig();
        config.forward_in_camera = mountings[m].conjugate() * kForward;
        NavigationGraph graph(config);
        drive(graph, survey, options);
        renewAll(graph, survey);
        const NavigationGraph::Counters &seen = graph.counters(), &r = reference.counters();
        EXPECT_EQ(seen.steps_contradicted, r.steps_contradicted);
        EXPECT_EQ(seen.steps_left_out, r.steps_left_out);
        EXPECT_EQ(seen.visual_rejected, r.visual_rejected);
        EXPECT_EQ(seen.compass_rejected, r.compass_rejected);
        EXPECT_EQ(seen.closures, r.closures);
        EXPECT_EQ(seen.references, r.references);
        errors[m] += std::pow(errorsOf(posesOf(graph), down.truth).aligned, 2);
      }
    }
    for (std::size_t m = 0; m < mountings.size(); ++m)
      EXPECT_LT(std::sqrt(errors[m] / least), c.within) << m << (c.closures ? " closures" : "");
  }
}

}  // namespace
}  // namespace fathom::slam

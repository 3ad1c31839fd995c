#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/navigation/gating/heading_gate.hpp"
#include "tests/world/hostile_dives.hpp"

namespace fathom::slam {
namespace {

using testing::errorsOf, testing::hostileDives, testing::posesOf, testing::runHostile;

// A straight track of one-second steps: the compass errs by `anomaly` at
// each step's end, link `false_at` by `false_turn`.
struct HeadingTrack {
  std::vector<double> anomaly;
  int false_at = -1;
  double false_turn = 0;
  bool gyro = false, visual = true, confirmed = false;
};

StepTurns stepOf(const HeadingTrack& track, int k) {
  StepTurns step{.seconds = 1};
  const auto at = static_cast<std::size_t>(k);
  step.compass = track.anomaly[at] - (k == 0 ? 0 : track.anomaly[at - 1]);
  step.has_visual = track.visual;
  step.visual = k == track.false_at ? track.false_turn : 0;
  step.visual_sigma = 0.1 * kRadiansPerDegree;
  step.confirmed = track.confirmed;
  step.has_gyro = track.gyro;
  step.gyro_sigma = 0.02 * kRadiansPerDegree;
  return step;
}

HeadingGate after(const HeadingTrack& track) {
  HeadingGate gate;
  for (int k = 0; k < static_cast<int>(track.anomaly.size()); ++k) gate.add(stepOf(track, k));
  return gate;
}

HeadingTrack bump(double degrees, double sigma, int steps = 200, int at = 90) {
  HeadingTrack track;
  for (int k = 0; k < steps; ++k)
    track.anomaly.push_back(degrees * kRadiansPerDegree * std::exp(-0.5 * std::pow((k - at) / sigma, 2)));
  return track;
}

int blamed(const HeadingGate& gate) {
  int count = 0;
  for (std::int64_t k = 0; k < gate.steps(); ++k) count += gate.verdict(k).visual ? 0 : 1;
  return count;
}

int restarts(const HeadingGate& gate) {
  int count = 0;
  for (std::int64_t k = 0; k < gate.steps(); ++k) count += gate.verdict(k).restarts ? 1 : 0;
  return count;
}

TEST(HeadingGate, AnAnomalyIsTheCompasssAndEndsWithIt) {
  for (const auto& [degrees, sigma] : {std::pair{10.0, 3.0}, {20.0, 5.0}, {40.0, 12.0}, {-25.0, 8.0}}) {
    const HeadingGate gate = after(bump(degrees, sigma));
    EXPECT_EQ(blamed(gate), 0) << degrees;
    EXPECT_EQ(restarts(gate), 0) << degrees;
    EXPECT_FALSE(gate.verdict(90).compass) << degrees;
    EXPECT_TRUE(gate.verdict(20).compass) << degrees;
    EXPECT_TRUE(gate.verdict(170).compass) << degrees;
  }
}

TEST(HeadingGate, AFalseLinkIsBlamedAndTheCompassIsNot) {
  for (const double degrees : {4.0, -7.0, 10.0}) {
    HeadingTrack track = bump(0, 1);
    track.false_at = 60;
    track.false_turn = degrees * kRadiansPerDegree;
    const HeadingGate gate = after(track);
    EXPECT_EQ(blamed(gate), 1) << degrees;
    EXPECT_FALSE(gate.verdict(60).visual) << degrees;
    for (const std::int64_t k : {59, 60, 61, 100, 199}) EXPECT_TRUE(gate.verdict(k).compass) << k;
  }
}

TEST(HeadingGate, AFalseLinkAmidAnAnomalyIsFound) {
  HeadingTrack track = bump(20, 5);
  track.false_at = 93;
  track.false_turn = 8 * kRadiansPerDegree;
  const HeadingGate gate = after(track);
  EXPECT_EQ(blamed(gate), 1);
  EXPECT_FALSE(gate.verdict(93).visual);
  EXPECT_TRUE(gate.verdict(150).compass);
}

TEST(HeadingGate, AGyroDistinguishesAJumpOfTheCompassFromAFalseLink) {
  HeadingTrack leap = bump(0, 1);
  for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = 7 * kRadiansPerDegree;
  // Without a gyro a link that is turned by as much is likelier.
  EXPECT_EQ(blamed(after(leap)), 1);
  leap.gyro = true;
  const HeadingGate gate = after(leap);
  EXPECT_EQ(blamed(gate), 0);
  EXPECT_EQ(restarts(gate), 1);
  EXPECT_TRUE(gate.verdict(60).restarts);
  HeadingTrack link = bump(0, 1);
  link.gyro = true;
  link.false_at = 60;
  link.false_turn = 7 * kRadiansPerDegree;
  EXPECT_EQ(blamed(after(link)), 1);
  EXPECT_EQ(restarts(after(link)), 0);
}

TEST(HeadingGate, SoDoTheOtherSensorsWhereTheyConfirmTheLink) {
  for (const double degrees : {4.0, -7.0, 10.0, 25.0}) {
    HeadingTrack leap = bump(0, 1);
    for (std::size_t k = 60; k < leap.anomaly.size(); ++k) leap.anomaly[k] = degrees * kRadiansPerDegree;
    leap.confirmed = true;
    const HeadingGate gate = after(leap);
    EXPECT_EQ(blamed(gate), 0) << degrees;
    EXPECT_EQ(restarts(gate), 1) << degrees;
    EXPECT_TRUE(gate.verdict(60).restarts) << degrees;
  }
  HeadingTrack track = bump(20, 5);
  track.confirmed = true;
  EXPECT_FALSE(after(track).verdict(90).compass);
}

TEST(HeadingGate, WithAGyroAnAnomalyIsSeenWithoutPictures) {
  HeadingTrack track = bump(20, 5);
  track.visual = false;
  EXPECT_TRUE(after(track).verdict(90).compass);  // no sensor contradicts it
  track.gyro = true;
  EXPECT_FALSE(after(track).verdict(90).compass);
  EXPECT_TRUE(after(track).verdict(150).compass);
}

TEST(HeadingGate, LearnsTheGyrosBias) {
  HeadingGate gate;
  for (int k = 0; k < 200; ++k) {
    StepTurns step{.seconds = 1};
    step.has_visual = step.has_gyro = true;
    step.visual_sigma = 0.1 * kRadiansPerDegree;
    step.gyro_sigma = 0.02 * kRadiansPerDegree;
    step.gyro = 8e-4;
    gate.add(step);
  }
  EXPECT_NEAR(gate.gyroBias(), 8e-4, 2e-5);
}

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
  testing::SyntheticDiveOptions options{.usbl_period = 1e9};
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

// A DVL that takes a layer in the water for the bottom moves with it, and then loses it. The first step of
// that shows no ground that images know.
TEST(OutlierGating, AFalseBottomThatBeginsBetweenLinksAndEndsInSilenceIsTheDvls) {
  const testing::SyntheticDiveOptions options;
  const testing::SyntheticDive survey = makeDive(options);
  constexpr int kFirst = 8;  // on a line
  for (const int steps : {2, 4, 8})
    for (const double speed : {-0.25, 0.25}) {
      NavigationGraph graph(testing::smallConfig());
      driveOn(graph, survey, options, kFirst);
      Eigen::Vector3d drift = Eigen::Vector3d::Zero();
      const int last = kFirst + steps + 3;
      for (int k = kFirst; k <= last; ++k) {
        KeyframeInput input = survey.inputs[static_cast<std::size_t>(k)];
        const double elapsed =
            static_cast<double>(input.utc_ns - survey.inputs[static_cast<std::size_t>(k - 1)].utc_ns) * 1e-9;
        drift.y() += speed * elapsed;
        input.T_odom_cam = SE3(input.T_odom_cam.rotation(), input.T_odom_cam.translation() + drift);
        if (k >= kFirst + steps) input.unlocked_s = elapsed;
        ASSERT_EQ(graph.addKeyframe(input), k);
        if (k > kFirst)
          (void)graph.addLink(LinkKind::kOdometry, k - 1, k,
                              survey.visual[static_cast<std::size_t>(k - 1)].T_a_b, survey.link_covariance);
        graph.judge();
      }
      const auto truth = [&](int k) { return survey.truth[static_cast<std::size_t>(k)]; };
      const SE3 off = (truth(kFirst).inverse() * truth(last)).inverse() *
                      (graph.pose(kFirst).inverse() * graph.pose(last));
      EXPECT_LT(off.translation().norm(), 0.05) << steps << " steps, " << speed << " m/s";
    }
}

// Dead reckoning stands still meanwhile, and a position fix is five metres off.
TEST(OutlierGating, StepsThatNothingMeasuresGoOnWithTheVelocityBefore) {
  const testing::SyntheticDiveOptions options;
  const testing::SyntheticDive survey = makeDive(options);
  constexpr int kFirst = 8, kLast = kFirst + 2;  // on a line
  NavigationGraph graph(testing::smallConfig());
  driveOn(graph, survey, options, kFirst);
  const auto truth = [&](int k) { return survey.truth[static_cast<std::size_t>(k)]; };
  LossOfTrack loss;
  for (int k = kFirst; k <= kLast; ++k) {
    KeyframeInput input = survey.inputs[static_cast<std::size_t>(k)];
    const KeyframeInput& before = survey.inputs[kFirst - 1];
    Eigen::Vector3d place = before.T_odom_cam.translation();
    place.z() = input.T_odom_cam.translation().z();
    const std::int64_t since = survey.inputs[static_cast<std::size_t>(k - 1)].utc_ns;
    input.unlocked_s = loss.add(static_cast<double>(input.utc_ns - since) * 1e-9);
    input.T_odom_cam = SE3(input.T_odom_cam.rotation(), place);
    ASSERT_EQ(graph.addKeyframe(input), k);
    graph.judge();
    (void)graph.step();
  }
  const Eigen::Vector2d off = truth(kLast).translation().head<2>() + Eigen::Vector2d(5, 0);
  (void)graph.addFix(kLast, graph.odometry(kLast).translation(), off, 2.0, false);
  for (int i = 0; i < 50; ++i) (void)graph.step();
  const SE3 error = (truth(kFirst - 1).inverse() * truth(kLast)).inverse() *
                    (graph.pose(kFirst - 1).inverse() * graph.pose(kLast));
  EXPECT_LT(error.translation().norm(), 0.3);
}

// Images that saw level ground curved, as a calibration may leave it, are turned along each mounting's own
// axes: closures show it, and without them the compass alone.
TEST(OutlierGating, JudgesTheStepsOfACameraThatLooksAheadAsThoseOfOneThatLooksDown) {
  testing::SyntheticDiveOptions options{.lines = 6};
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

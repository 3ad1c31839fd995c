// The mathematics of check-calibration on synthetic matches, ranges and motions.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "realtime/base/units.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "tests/world/rigs.hpp"

namespace fathom::calibration {
namespace {

// Matches of a rough seafloor about 2 m away, with noise and a fifth of outliers.
std::vector<RigMatch> syntheticMatches(const StereoRig& rig, std::size_t count, double noise_px) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, noise_px);
  std::uniform_real_distribution<double> evenly(0, 1);
  std::vector<RigMatch> matches;
  while (matches.size() < count) {
    const Eigen::Vector2d left(evenly(random) * rig.left.width, evenly(random) * rig.left.height);
    const Eigen::Vector3d point = (1.8 + 0.4 * evenly(random)) * rig.left.ray(left);
    Eigen::Vector2d right = rig.right.project(rig.T_right_left * point);
    if (!rig.right.contains(right)) continue;
    right += Eigen::Vector2d(noise(random), noise(random));
    if (matches.size() % 5 == 4) right.y() += 40 * evenly(random) - 20;
    matches.push_back({left, right});
  }
  return matches;
}

StereoRig withRightTurned(const StereoRig& rig, const Eigen::Vector3d& degrees) {
  StereoRig out = rig;
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = kRadiansPerDegree * degrees;
  out.T_right_left = SE3::exp(twist) * rig.T_right_left;
  return out;
}

TEST(EpipolarCheck, OfTheTrueRigIsTheMatchesNoise) {
  const StereoRig rig = test::syntheticRig();
  const EpipolarCheck check = checkEpipolar(rig, syntheticMatches(rig, 4000, 0.1));
  EXPECT_NEAR(check.median, 0, 0.01);
  EXPECT_NEAR(check.sigma, 0.1, 0.04);  // a fifth of wrong matches widens it
  EXPECT_LT(std::abs(check.worst_cell), 0.08);
  EXPECT_LT(check.change.rotation.norm(), 0.05 * kRadiansPerDegree);
}

TEST(EpipolarCheck, ErrorsArePositiveWhereTheMatchIsBelowItsLine) {
  const StereoRig rig = test::syntheticRig();
  RigMatch match = syntheticMatches(rig, 1, 0)[0];
  EXPECT_NEAR(epipolarError(rig, match), 0, 1e-9);
  match.right.y() += 2;
  EXPECT_NEAR(epipolarError(rig, match), 2, 0.2);  // the lens stretches a little
}

TEST(EpipolarCheck, ATurnedCameraIsMeasuredAboutEachAxis) {
  const StereoRig truth = test::syntheticRig();
  const auto matches = syntheticMatches(truth, 6000, 0.1);
  for (const Eigen::Vector3d& turn :
       {Eigen::Vector3d(0.3, 0, 0), Eigen::Vector3d(-0.1, 0, 0.4), Eigen::Vector3d(0, 0.8, 0)}) {
    // The rig was calibrated turned: the camera is now turned in the opposite direction.
    const EpipolarCheck check = checkEpipolar(withRightTurned(truth, turn), matches);
    for (int i = 0; i < 3; ++i)
      EXPECT_NEAR(check.change.rotation(i) / kRadiansPerDegree, -turn(i),
                  0.01 + 4 * check.change_sigma.rotation(i) / kRadiansPerDegree)
          << turn.transpose();
    EXPECT_LT(check.sigma_after, 0.2);
  }
}

// Poor images place matches to more than half a pixel: a turn that is several times that is still measured,
// a lesser one is not, nor is one made up from matches that have nothing in common.
TEST(EpipolarCheck, ALargeTurnIsMeasuredByPoorMatchesToo) {
  const StereoRig truth = test::syntheticRig();
  const auto poor = syntheticMatches(truth, 4000, 0.55);
  const EpipolarCheck turned = checkEpipolar(withRightTurned(truth, {0.2, 0, 0.1}), poor);
  EXPECT_GT(turned.sigma_after, kMostMedian);
  EXPECT_TRUE(explainsMove(turned));
  EXPECT_NEAR(turned.change.rotation.x() / kRadiansPerDegree, -0.2, 0.02);
  EXPECT_FALSE(measuresRig(checkEpipolar(withRightTurned(truth, {0.03, 0, 0}), poor)));
  std::vector<RigMatch> random = poor;
  for (std::size_t k = 0; k < random.size(); ++k)
    random[k].right = poor[(k * 1237 + 611) % poor.size()].right;
  EXPECT_FALSE(measuresRig(checkEpipolar(truth, random)));
}

TEST(EpipolarCheck, FocalLengthsThatDifferAreSeparatedFromATurn) {
  const StereoRig truth = test::syntheticRig();
  const auto matches = syntheticMatches(truth, 6000, 0.1);
  const Eigen::Vector3d turn(0.2, 0, -0.1);
  StereoRig nominal = withRightTurned(truth, turn);
  nominal.left.fx *= 1.003, nominal.left.fy *= 1.003;
  nominal.right.fx *= 0.997, nominal.right.fy *= 0.997;
  const EpipolarCheck check = checkEpipolar(nominal, matches);
  EXPECT_TRUE(hasMoved(check));
  EXPECT_NEAR(check.change.focal, 0.006, 0.0006);
  const StereoRig corrected = changed(nominal, check.change);
  EXPECT_FALSE(hasMoved(checkEpipolar(corrected, matches)));
  for (const auto& [a, b] : {std::pair(&corrected.left, &truth.left), {&corrected.right, &truth.right}})
    EXPECT_NEAR(a->fx, b->fx, 0.001 * b->fx);
  EXPECT_LT(
      corrected.T_right_left.rotation().angularDistance(truth.T_right_left.rotation()) / kRadiansPerDegree,
      0.06);
  EXPECT_NEAR(corrected.baseline(), truth.baseline(), 1e-12);
}

// Lenses that distort otherwise than they were calibrated to, one more and one less, bend the ground.
TEST(EpipolarCheck, LensesThatDistortDifferentlyAreMeasured) {
  const StereoRig truth = test::syntheticRig();
  const auto matches = syntheticMatches(truth, 4000, 0.15);
  StereoRig nominal = withRightTurned(truth, {0.1, 0, 0.05});
  nominal.left.k1 += 0.01, nominal.right.k1 -= 0.01;
  nominal.left.fx *= 1.001, nominal.left.fy *= 1.001;
  const EpipolarCheck check = checkEpipolar(nominal, matches);
  EXPECT_TRUE(explainsMove(check));
  EXPECT_NEAR(check.change.radial, 0.02, 0.002);
  EXPECT_NEAR(check.change.radial, 0.02, 8 * check.change_sigma.radial);
  // How far level ground is off a plane, by points of a grid over the view [m].
  const auto bent = [&](const StereoRig& rig) {
    std::vector<double> off;
    for (const double x : {-0.3, -0.15, 0.0, 0.15, 0.3})
      for (const double y : {-0.25, 0.0, 0.25})
        off.push_back(retriangulated(truth, rig, {2 * x, 2 * y, 2}).z());
    const auto [low, high] = std::ranges::minmax(off);
    return high - low;
  };
  EXPECT_GT(bent(nominal), 0.03);
  EXPECT_LT(bent(changed(nominal, check.change)), 0.01);
}

int changesBy(RigWatch& watch, const std::vector<RigMatch>& matches) {
  int changed = 0;
  for (std::size_t k = 0; k + RigWatch::kOfPair <= matches.size(); k += RigWatch::kOfPair)
    changed += watch.add({matches.data() + k, RigWatch::kOfPair}) ? 1 : 0;
  return changed;
}

double rangeErrorOf(const StereoRig& rig, const StereoRig& truth) {
  return rangeChange(truth, rig).at(2);
}

// Epipolar lines are right from the first pair on; a turn about y takes more pairs.
TEST(RigWatch, OnePairCorrectsEpipolarLinesBeforeTheRigIsMeasured) {
  const StereoRig truth = test::syntheticRig();
  const auto matches = syntheticMatches(truth, 300, 0.1);
  const auto median = [&](const StereoRig& rig) {
    std::vector<double> off;
    for (const RigMatch& match : matches) off.push_back(std::abs(epipolarError(rig, match)));
    std::nth_element(off.begin(), off.begin() + off.size() / 2, off.end());
    return off[off.size() / 2];
  };
  // By roll alone, half of the matches are off to either side.
  for (const Eigen::Vector3d& degrees : {Eigen::Vector3d(0.2, 0.1, -0.1), Eigen::Vector3d(0, 0, 1)}) {
    const StereoRig nominal = withRightTurned(truth, degrees);
    RigWatch watch(nominal);
    EXPECT_GT(median(nominal), 2);
    EXPECT_FALSE(watch.correctAtStart({matches.begin(), matches.begin() + 50})) << "too few matches";
    EXPECT_TRUE(watch.correctAtStart(matches));
    EXPECT_EQ(watch.changes(), 1U);
    EXPECT_LT(median(watch.rig()), 0.3);
    EXPECT_NEAR((watch.rig().T_right_left * nominal.T_right_left.inverse()).log()(4), 0, 1e-5);
    EXPECT_EQ(watch.history().best(0), watch.history().newest()) << "unchanged from the start";
    EXPECT_FALSE(watch.correctAtStart(matches)) << "once";
  }
  RigWatch good(truth);
  EXPECT_FALSE(good.correctAtStart(matches));
}

// Small turns too: a match half a pixel off its line is within the gate of stereo, and every range 8 % too
// short.
TEST(RigWatch, ATurnAboutAnyAxisIsCorrectedWithinTheAccuracyOfTheMatches) {
  const StereoRig truth = test::syntheticRig();
  const auto matches = syntheticMatches(truth, RigWatch::kHeld, 0.1);
  for (const double degrees : {0.05, -0.05, 0.2, -0.2, 1.0, -1.0})
    for (int axis = 0; axis < 3; ++axis) {
      RigWatch watch(withRightTurned(truth, degrees * Eigen::Vector3d::Unit(axis)));
      (void)changesBy(watch, matches);
      EXPECT_NEAR(watch.change().rotation(axis) / kRadiansPerDegree, -degrees, 0.012)
          << degrees << " about " << axis;
      EXPECT_NEAR(rangeErrorOf(watch.rig(), truth), 0, 0.006) << degrees << " about " << axis;
      EXPECT_LT(watch.yawSigma() / kRadiansPerDegree, 0.02);
      EXPECT_EQ(watch.history().best(0), watch.history().newest()) << "unchanged from the start";
    }
}

TEST(RigWatch, ManyMatchesAreMoreAccurateThanFew) {
  const StereoRig truth = test::syntheticRig();
  RigWatch watch(withRightTurned(truth, {0, 0.1, 0}));
  (void)changesBy(watch, syntheticMatches(truth, RigWatch::kHeld + 4 * RigWatch::kToRefine, 0.1));
  EXPECT_NEAR(rangeErrorOf(watch.rig(), truth), 0, 0.002);
  EXPECT_EQ(watch.resets(), 1u);
  EXPECT_EQ(watch.changes(), 0u) << "within the tolerance of stereo";
  EXPECT_LT(watch.history().newest(), 6);
}

// Knocked in the middle of a dive.
TEST(RigWatch, FollowsARigThatIsKnocked) {
  const StereoRig nominal = test::syntheticRig();
  const auto before = syntheticMatches(nominal, RigWatch::kHeld + 2 * RigWatch::kToRefine, 0.1);
  for (const Eigen::Vector3d& turn : {Eigen::Vector3d(0.3, 0, 0.1), Eigen::Vector3d(0, 0.15, 0)}) {
    const StereoRig knocked = withRightTurned(nominal, turn);
    const auto after = syntheticMatches(knocked, 2 * RigWatch::kToRefine, 0.1);
    RigWatch watch(nominal);
    (void)changesBy(watch, before);
    const int stood = watch.history().newest();
    EXPECT_EQ(watch.resets(), 1u);
    EXPECT_GE(changesBy(watch, after), 1);
    EXPECT_EQ(watch.resets(), 2u);
    EXPECT_EQ(watch.changes(), turn.x() > 0 ? 1u : 0u);
    EXPECT_LT((watch.change().rotation / kRadiansPerDegree - turn).norm(), 0.01);
    EXPECT_EQ(watch.history().best(stood), stood) << "the rig differed at that time";
  }
}

// Baseline and principal points, which do not show in epipolar lines.
TEST(RigHistory, ARangeErrorIsCorrectedAndPointsAreTriangulatedAgain) {
  const StereoRig truth = test::syntheticRig();
  StereoRig nominal = truth;
  nominal.T_right_left = SE3(nominal.T_right_left.rotation(), 1.007 * nominal.T_right_left.translation());
  nominal.right.cx += 0.001 * nominal.right.width;
  const RangeError error = rangeChange(truth, nominal);
  EXPECT_GT(std::abs(error.at(2)), 0.01);
  const StereoRig found = withoutRangeError(nominal, error);
  for (const double range : {1.2, 2.0, 3.0}) EXPECT_NEAR(rangeChange(truth, found).at(range), 0, 1e-3);
  const Eigen::Vector3d point(0.4, -0.3, 2.1), moved = retriangulated(truth, nominal, point);
  EXPECT_GT((moved - point).norm(), 0.02);
  EXPECT_LT((retriangulated(nominal, truth, moved) - point).norm(), 1e-6);
  RigHistory history(nominal);
  history.add(found, true);
  history.add(truth, false);
  EXPECT_EQ(history.best(0), 1);
  EXPECT_EQ(history.best(2), 2);
}

TEST(RigWatch, TakesNoRigFromRandomMatches) {
  RigWatch watch(test::syntheticRig());
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(0, test::syntheticRig().left.width), off(-15, 15);
  for (int k = 0; k < 40'000; k += static_cast<int>(RigWatch::kOfPair)) {
    std::vector<RigMatch> matches(RigWatch::kOfPair);
    for (RigMatch& m : matches) {
      m.left = {x(random), 0.75 * x(random)};
      m.right = m.left + Eigen::Vector2d(off(random) - 40, off(random));
    }
    EXPECT_FALSE(watch.add(matches));
  }
}

TEST(EpipolarCheck, NoMatchesGiveZeros) {
  const EpipolarCheck check = checkEpipolar(test::syntheticRig(), {});
  EXPECT_EQ(check.median, 0);
  EXPECT_EQ(check.cells.size(), 48u);
}

std::vector<RangeSample> syntheticRanges(double scale, double offset, double shortest, double longest) {
  std::mt19937 random(2);
  std::normal_distribution<double> noise(0, 0.03);
  std::vector<RangeSample> samples;
  for (int k = 0; k < 300; ++k) {
    const double dvl = shortest + (longest - shortest) * (0.5 + 0.5 * std::sin(0.07 * k));
    samples.push_back({scale * dvl + offset + noise(random) + (k % 10 == 0 ? 0.8 : 0.0), dvl});
  }
  return samples;
}

TEST(RangeCheck, AScaleIsMeasuredInSpiteOfOutliers) {
  const RangeCheck check = checkRanges(syntheticRanges(1.05, 0, 1.9, 2.2));
  EXPECT_NEAR(check.ratio, 1.05, 3 * check.ratio_sigma + 0.003);
  EXPECT_LT(check.ratio_sigma, 0.01);
  EXPECT_FALSE(check.line_known);  // one altitude
}

TEST(RangeCheck, ScaleAndOffsetAreSeparatedOverManyAltitudes) {
  const RangeCheck check = checkRanges(syntheticRanges(0.97, 0.15, 1.5, 5));
  ASSERT_TRUE(check.line_known);
  EXPECT_NEAR(check.scale, 0.97, 0.01);
  EXPECT_NEAR(check.offset, 0.15, 0.03);
  EXPECT_GT(check.scale_sigma, 0);
  EXPECT_NEAR(check.scale, 0.97, 4 * check.scale_sigma + 1e-3);
}

TEST(RangeCheck, TooFewSamplesAreOnlyCounted) {
  const RangeCheck check = checkRanges({{2, 2}, {2, 2}});
  EXPECT_EQ(check.samples, 2u);
  EXPECT_EQ(check.ratio_sigma, 0);
}

// Steps of half a metre a second with rolling and, if asked for, turns; by a camera mounted as `truth`.
std::vector<MotionStep> syntheticSteps(const SE3& truth, std::size_t count, bool turns, double noise) {
  std::mt19937 random(3);
  std::normal_distribution<double> gauss(0, 1);
  std::vector<MotionStep> steps;
  for (std::size_t k = 0; k < count; ++k) {
    const double t = static_cast<double>(k);
    const SE3 T_b0_b1 = SE3::fromEuler(turns ? 0.02 * std::sin(t) : 0, turns ? 0.02 * std::cos(1.7 * t) : 0,
                                       turns && k % 12 > 7 ? 0.4 : 0, {0.25, 0, 0});
    const SE3 T_b1_b0 = T_b0_b1.inverse();
    const SE3 T_c1_c0 = truth.inverse() * T_b1_b0 * truth;
    Vector6d shake = Vector6d::Zero();
    shake.tail<3>() = 0.3 * noise * Eigen::Vector3d(gauss(random), gauss(random), gauss(random));
    const Eigen::Vector3d middle(0.05 * gauss(random), 0.05 * gauss(random), 1.9);
    steps.push_back(
        {T_b1_b0, (SE3::exp(shake) * T_c1_c0).rotation(), middle,
         T_c1_c0 * middle + noise * Eigen::Vector3d(gauss(random), gauss(random), gauss(random))});
  }
  if (count > 10) steps[10].middle1 += Eigen::Vector3d(0.5, 0, 0);  // an outlier
  return steps;
}

const SE3 kAssumed = SE3::fromEuler(0.0105, -0.0157, 1.5847, {0.42, -0.03, 0.28});

SE3 turnedMount(const Eigen::Vector3d& degrees) {
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = kRadiansPerDegree * degrees;
  return {SE3::exp(twist).rotation() * kAssumed.rotation(), kAssumed.translation()};
}

TEST(MountAlignment, AMissionWithTurnsGivesAllThreeAngles) {
  const Eigen::Vector3d off(2.0, -3.0, 1.0);  // roll, pitch, yaw [deg]
  const MountAlignment done = alignMount(syntheticSteps(turnedMount(off), 120, true, 0.005), kAssumed);
  ASSERT_TRUE(done.both.known);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(done.both.rotation(i) / kRadiansPerDegree, off(i),
                0.1 + 4 * done.both.sigma(i) / kRadiansPerDegree);
    EXPECT_LT(done.both.sigma(i), 0.3 * kRadiansPerDegree);
  }
  EXPECT_NEAR(done.speed_ratio, 1.0, 0.01);
}

TEST(MountAlignment, AStraightLineLeavesTheAngleAboutItsDirectionOpen) {
  const MountAlignment done = alignMount(syntheticSteps(turnedMount({0, 2, -1}), 60, false, 0.005), kAssumed);
  EXPECT_TRUE(std::isinf(done.dvl.sigma(0)) || done.dvl.sigma(0) > 2 * kRadiansPerDegree);
  EXPECT_NEAR(done.dvl.rotation(1) / kRadiansPerDegree, 2, 0.5);
  EXPECT_NEAR(done.dvl.rotation(2) / kRadiansPerDegree, -1, 0.5);
  EXPECT_TRUE(std::isinf(done.compass.sigma(0)));
}

TEST(MountAlignment, TooFewStepsAreOnlyCounted) {
  const MountAlignment done = alignMount(syntheticSteps(kAssumed, 5, true, 0), kAssumed);
  EXPECT_EQ(done.steps, 5u);
  EXPECT_FALSE(done.both.known);
}

}  // namespace
}  // namespace fathom::calibration

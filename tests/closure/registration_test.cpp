#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "recon/closure/point_alignment.hpp"
#include "recon/closure/registration.hpp"
#include "recon/geometry/uncertain_pose.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::closure {
namespace {

using test::featuresOf, test::lookingDown, test::Seafloor, test::smallRig;

Seafloor rollingReef(std::uint32_t seed) {
  return {[](double n, double e) { return 2.0 + 0.10 * std::sin(2.1 * n + 0.3) * std::cos(1.7 * e); },
          test::randomTexture(0.006, seed)};
}

TEST(Registration, FindsTheRelativePoseOfTurnedAndShiftedFramesWithinMillimetres) {
  const Seafloor reef = rollingReef(1);
  const SE3 a = lookingDown(0, 0, 0, 0.1), b = lookingDown(0.35, -0.25, 0.08, 2.4, 0.05, -0.04);
  Registrar registrar(smallRig(), {});
  const Registration& r = registrar.process(featuresOf(reef, a, 1), featuresOf(reef, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  const Vector6d e = perturbation(r.T_a_b, a.inverse() * b);
  std::printf("%.2f mm, %.2f mrad off\n", 1e3 * e.head<3>().norm(), 1e3 * e.tail<3>().norm());
  EXPECT_LT(e.head<3>().norm(), 0.0066);  // twice what was measured
  EXPECT_LT(e.tail<3>().norm(), 0.0034);
  EXPECT_LT(e.dot(r.covariance.ldlt().solve(e)), 22.5);  // 99.9 % of chi-square with 6 degrees of freedom
}

TEST(Registration, RefusesFramesOfDifferentPlaces) {
  const Seafloor reef = rollingReef(1);
  Registrar registrar(smallRig(), {});
  const FrameFeatures a = featuresOf(reef, lookingDown(0, 0, 0, 0), 1);
  for (const double north : {6.0, 9.0, 14.0}) {
    const FrameFeatures b = featuresOf(reef, lookingDown(north, 3, 0, 0.4), 3);
    EXPECT_FALSE(registrar.process(a, b, std::nullopt).accepted());
  }
}

TEST(Registration, RefusesAPoseThatContradictsThePrior) {
  const Seafloor reef = rollingReef(2);
  const SE3 a = lookingDown(0, 0, 0, 0), b = lookingDown(0.3, 0.1, 0, 0.5);
  const FrameFeatures fa = featuresOf(reef, a, 1), fb = featuresOf(reef, b, 2);
  Registrar registrar(smallRig(), {});
  RelativePrior prior{a.inverse() * b, 0.0025 * Matrix6d::Identity()};
  EXPECT_TRUE(registrar.process(fa, fb, prior).accepted());
  prior.T_a_b = SE3(prior.T_a_b.rotation(), prior.T_a_b.translation() + Eigen::Vector3d(0.6, 0, 0));
  EXPECT_FALSE(registrar.process(fa, fb, prior).accepted());
  prior.covariance(2, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(registrar.process(fa, fb, prior).refusal, Refusal::kContradiction);
}

TEST(Registration, RefusesFramesWithoutFeatures) {
  const FrameFeatures some = featuresOf(rollingReef(3), lookingDown(0, 0, 0, 0), 1);
  Registrar registrar(smallRig(), {});
  EXPECT_EQ(registrar.process(some, {}, std::nullopt).refusal, Refusal::kNoFeatures);
  EXPECT_EQ(registrar.process({}, {}, std::nullopt).refusal, Refusal::kNoFeatures);
}

TEST(Registration, GivesTheSameBytesTwice) {
  const Seafloor reef = rollingReef(4);
  const FrameFeatures a = featuresOf(reef, lookingDown(0, 0, 0, 0), 1);
  const FrameFeatures b = featuresOf(reef, lookingDown(0.3, 0.2, 0, 1.0), 2);
  Registrar first(smallRig(), {}), second(smallRig(), {});
  second.process(b, a, std::nullopt);
  const Registration r = first.process(a, b, std::nullopt);
  const Registration& s = second.process(a, b, std::nullopt);
  ASSERT_TRUE(r.accepted());
  EXPECT_EQ(r.T_a_b.translation(), s.T_a_b.translation());
  EXPECT_EQ(r.T_a_b.rotation().coeffs(), s.T_a_b.rotation().coeffs());
  EXPECT_EQ(r.covariance, s.covariance);
}

// `value` modulo `period`, 0 to `period`.
double within(double value, double period) {
  return value - period * std::floor(value / period);
}

// Grounds with different places that look the same follow: a false closure is worse than a missed one.

// Ripples of sand with crests along east, all alike: `own` is the part of the texture that is not repeated.
Seafloor ripples(double period, double own) {
  const auto repeated = test::randomTexture(0.006, 21), unique = test::randomTexture(0.006, 22);
  return {[period](double n, double) { return 2.0 + 0.02 * std::sin(2 * M_PI * n / period); },
          [=](double n, double e) {
            return (1 - own) * repeated(within(n, period), within(e, period)) + own * unique(n, e);
          }};
}

// Sand of its own everywhere, and two boulders that are copies of each other, `apart` to the north.
Seafloor twoBoulders(double radius, double apart) {
  const auto sand = test::randomTexture(0.006, 31), rock = test::randomTexture(0.006, 32);
  const auto local = [=](double n) { return n > apart / 2 ? n - apart : n; };
  return {
      [=](double n, double e) {
        const double r = std::hypot(local(n), e) / radius;
        return 2.0 - (r < 1 ? 0.25 * (1 - r * r) * (1 - r * r) : 0.0);
      },
      [=](double n, double e) { return std::hypot(local(n), e) < radius ? rock(local(n), e) : sand(n, e); }};
}

TEST(LookAlikes, RipplesThatRepeatGiveNoClosureBetweenDifferentPlaces) {
  Registrar registrar(smallRig(), {});
  for (const double own : {0.0, 0.3}) {
    for (const double period : {0.15, 0.4}) {
      const Seafloor sand = ripples(period, own);
      const FrameFeatures a = featuresOf(sand, lookingDown(0, 0, 0, 0), 1);
      ASSERT_GT(a.size(), 100U);
      // Whole periods away, so that the frames would fit each other; and a part of one.
      for (const double periods : {20.0, 30.3}) {
        const FrameFeatures b = featuresOf(sand, lookingDown(periods * period, 0.05, 0, 0.1), 2);
        const Registration& r = registrar.process(a, b, std::nullopt);
        EXPECT_FALSE(r.accepted()) << own << ' ' << period << ' ' << periods << ": " << r.inliers.size();
      }
    }
  }
}

TEST(LookAlikes, ABoulderThatLooksLikeAnotherGivesNoClosure) {
  Registrar registrar(smallRig(), {});
  for (const double radius : {0.3, 0.45}) {
    const Seafloor ground = twoBoulders(radius, 8);
    const FrameFeatures a = featuresOf(ground, lookingDown(0.05, 0.0, 0, 0), 1);
    const FrameFeatures b = featuresOf(ground, lookingDown(8.0, 0.1, 0, 0.5), 2);
    const Registration& r = registrar.process(a, b, std::nullopt);
    EXPECT_FALSE(r.accepted()) << radius << ": " << r.inliers.size() << " coverage " << r.coverage;
  }
}

TEST(LookAlikes, TheSameBoulderInTwoFramesIsAClosure) {
  const Seafloor ground = twoBoulders(0.45, 8);
  Registrar registrar(smallRig(), {});
  const SE3 a = lookingDown(0.05, 0.0, 0, 0), b = lookingDown(0.1, 0.2, 0, 0.5);
  const Registration& r = registrar.process(featuresOf(ground, a, 1), featuresOf(ground, b, 2), std::nullopt);
  ASSERT_TRUE(r.accepted()) << nameOf(r.refusal);
  EXPECT_LT((r.T_a_b.translation() - (a.inverse() * b).translation()).norm(), 0.02);
}

// At the images' edges the boulders fill the whole overlap that the frames would have: the prior of the path
// between must refuse them.
TEST(LookAlikes, LookAlikeBouldersAtTheEdgeAreRefusedByThePriorOfThePath) {
  const Seafloor ground = twoBoulders(0.3, 4);
  const SE3 a = lookingDown(-0.45, 0, 0, 0), b = lookingDown(4.45, 0, 0, 0);
  Matrix6d covariance = 0.0004 * Matrix6d::Identity();
  covariance(0, 0) = covariance(1, 1) = 0.25;  // half a metre
  Registrar registrar(smallRig(), {});
  EXPECT_FALSE(registrar
                   .process(featuresOf(ground, a, 1), featuresOf(ground, b, 2),
                            RelativePrior{a.inverse() * b, covariance})
                   .accepted());
}

constexpr double kFocal = 860, kBaseline = 0.07;  // [px], [m]

// Points as stereo measures them: 0.2 px aside, 0.08 px in disparity.
Eigen::Matrix3d stereoCovariance(const Eigen::Vector3d& p) {
  const double aside = 0.2 * p.z() / kFocal, along = 0.08 * p.z() / (kFocal * kBaseline);
  Eigen::Matrix3d c = aside * aside * Eigen::Matrix3d::Identity();
  c += along * along * p * p.transpose();
  return c;
}

class SyntheticPairs {
 public:
  explicit SyntheticPairs(std::uint32_t seed) : random_(seed) {}

  Vector6d twist(double position, double angle) {
    Vector6d v;
    for (int k = 0; k < 6; ++k) v(k) = (k < 3 ? position : angle) * normal_(random_);
    return v;
  }

  // Pairs under `truth` with noise of their covariances and one draw of shared errors.
  std::vector<PointPair> pairs(const SE3& truth, int count, const SharedErrors& errors) {
    Eigen::Matrix<double, kSharedErrors, 1> shared;
    for (double& u : shared) u = normal_(random_);
    std::uniform_real_distribution<double> tangent(-0.35, 0.35), depth(1.7, 2.3);
    std::vector<PointPair> result;
    for (int k = 0; k < count; ++k) {
      const double z = depth(random_);
      const Eigen::Vector3d b(z * tangent(random_), z * tangent(random_), z), a = truth * b;
      PointPair p{a,
                  b,
                  stereoCovariance(a),
                  stereoCovariance(b),
                  sharedJacobian(errors, kFocal, kBaseline, a),
                  sharedJacobian(errors, kFocal, kBaseline, b)};
      p.a += noise(p.covariance_a) + p.shared_a * shared;
      p.b += noise(p.covariance_b) + p.shared_b * shared;
      result.push_back(p);
    }
    return result;
  }

 private:
  Eigen::Vector3d noise(const Eigen::Matrix3d& covariance) {
    const Eigen::Vector3d unit(normal_(random_), normal_(random_), normal_(random_));
    return covariance.llt().matrixL() * unit;
  }
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

SE3 turned(double yaw) {
  return SE3::fromEuler(0.04, -0.03, yaw, {0.3, -0.2, 0.1});
}

TEST(AlignPoints, CovarianceIsConsistentOverManyDrawsOfNoiseAndSharedErrors) {
  SyntheticPairs synthetic(3);
  double nees = 0;
  constexpr int kTrials = 1000;
  for (int k = 0; k < kTrials; ++k) {
    const SE3 truth = turned(0.02 * k);
    const auto pairs = synthetic.pairs(truth, 80, {});
    const SE3 start = perturbed(truth, synthetic.twist(0.005, 0.003));
    const auto found = alignPoints(pairs, refineCauchy(pairs, start));
    ASSERT_TRUE(found);
    const Vector6d e = perturbation(found->T_a_b, truth);
    nees += e.dot(found->covariance.ldlt().solve(e)) / kTrials;
  }
  // 6 within 95 % of 1000 draws is 5.8 to 6.2; the inlier test and linearisation take their part.
  EXPECT_GT(nees, 5.0);
  EXPECT_LT(nees, 7.0);
}

// A slope of the disparity across the track turns every step to the same side.
TEST(AlignPoints, SharedErrorsMoveThePoseAsPredicted) {
  constexpr double kFocalLength = 1700, kApart = 0.07, kRange = 2, kSmall = 0.1;
  const Eigen::Vector2d half_view(0.4, 0.3);
  SharedErrors errors{.disparity_curve = 0.3};
  const SE3 T_a_b = SE3::fromEuler(0.01, -0.02, 0.3, {0.05, -0.25, 0.01});
  const auto predicted = poseBySharedErrors(errors, kFocalLength, kApart, half_view, kRange, T_a_b);
  EXPECT_GT(std::abs(predicted(5, 4)), 5e-5);
  for (int column = 0; column < kCommonErrors; ++column) {
    std::vector<PointPair> pairs;
    for (double y = -0.3; y <= 0.3; y += 0.02)
      for (double x = -0.4; x <= 0.4; x += 0.02) {
        const Eigen::Vector3d b = kRange * Eigen::Vector3d(x, y, 1), a = T_a_b * b;
        if ((a.hnormalized().cwiseAbs() - half_view).maxCoeff() > 0) continue;
        const Eigen::Matrix3d spread = Eigen::Vector3d(1e-6, 1e-6, 9e-6).asDiagonal();
        pairs.push_back({a + kSmall * commonJacobian(errors, kFocalLength, kApart, a).col(column),
                         b + kSmall * commonJacobian(errors, kFocalLength, kApart, b).col(column), spread,
                         spread});
      }
    const auto found = alignPoints(pairs, T_a_b);
    ASSERT_TRUE(found);
    const Vector6d moved = (T_a_b.inverse() * found->T_a_b).log() / kSmall;
    EXPECT_LT((moved - predicted.col(column)).norm(), 0.1 * moved.norm() + 2e-5) << column;
  }
}

TEST(AlignPoints, SharedErrorsDoNotBiasViewsWithoutOverlap) {
  const SE3 away(Eigen::Quaterniond::Identity(), {5, 0, 0});
  EXPECT_TRUE(poseBySharedErrors({}, 1700, 0.07, {0.4, 0.3}, 2, away).isZero(0));
}

TEST(AlignPoints, AcceptsNineteenOfTwentyInliers) {
  SyntheticPairs synthetic(4);
  const SE3 truth = turned(1.0);
  const auto found = alignPoints(synthetic.pairs(truth, 4000, {}), truth);
  ASSERT_TRUE(found);
  EXPECT_NEAR(static_cast<double>(found->inliers.size()) / 4000, 0.95, 0.015);
  EXPECT_NEAR(found->noise, 1.0, 0.05);
}

TEST(AlignPoints, GivesNothingForTooFewPoints) {
  SyntheticPairs synthetic(5);
  const SE3 truth = turned(0.3);
  EXPECT_FALSE(alignPoints({}, truth));
  EXPECT_FALSE(alignPoints(synthetic.pairs(truth, 3, {}), truth));
}

TEST(SampleConsensus, FindsThePoseAmongFourTimesAsManyWrongMatches) {
  SyntheticPairs synthetic(6);
  const SE3 truth = turned(2.0);
  auto pairs = synthetic.pairs(truth, 150, {});
  for (std::size_t k = 30; k < pairs.size(); ++k) std::swap(pairs[k].a, pairs[(k * 7 + 11) % 120 + 30].a);
  const auto found = sampleConsensus(pairs, {}, nullptr, nullptr);
  ASSERT_TRUE(found);
  EXPECT_GE(found->inliers.size(), 24U);
  const auto aligned = alignPoints(pairs, refineCauchy(pairs, found->T_a_b));
  ASSERT_TRUE(aligned);
  EXPECT_LT(perturbation(aligned->T_a_b, truth).head<3>().norm(), 0.02);
}

TEST(SampleConsensus, GivesNothingWithoutPairs) {
  EXPECT_FALSE(sampleConsensus({}, {}, nullptr, nullptr));
}

TEST(AbsoluteOrientation, IsExactForExactPointsAndRefusesALine) {
  const SE3 truth = turned(-2.5);
  std::vector<PointPair> pairs;
  for (const Eigen::Vector3d& b : {Eigen::Vector3d(0.5, 0, 2), Eigen::Vector3d(-0.3, 0.4, 2.1),
                                   Eigen::Vector3d(0, -0.4, 1.8), Eigen::Vector3d(0.1, 0.8, 2.4)})
    pairs.push_back({truth * b, b, stereoCovariance(b), stereoCovariance(b)});
  const auto pose = absoluteOrientation(pairs, {0, 1, 2, 3});
  ASSERT_TRUE(pose);
  EXPECT_LT(perturbation(*pose, truth).norm(), 1e-9);
  EXPECT_FALSE(absoluteOrientation(pairs, {0, 1}));
  EXPECT_FALSE(absoluteOrientation(pairs, {0, 0, 1}));
}

TEST(SharedErrors, ADisparityErrorMovesAPointAlongItsRayByTheRigsBaseline) {
  SharedErrors errors{.disparity = 0.01};
  const Eigen::Vector3d point(0.3, -0.2, 2.0);
  const double disparity = kFocal * kBaseline / point.z();
  const Eigen::Vector3d moved = point * (disparity / (disparity + errors.disparity)) - point;
  const SharedJacobian j = sharedJacobian(errors, kFocal, kBaseline, point);
  EXPECT_LT((j.col(3) - moved).norm(), 1e-3 * moved.norm());
}

}  // namespace
}  // namespace fathom::closure

#include "recon/closure/point_alignment.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::closure {
namespace {

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
  SharedErrors errors;
  errors.disparity_curve = 0.3;
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
  SharedErrors errors;
  errors.disparity = 0.01;
  const Eigen::Vector3d point(0.3, -0.2, 2.0);
  const double disparity = kFocal * kBaseline / point.z();
  const Eigen::Vector3d moved = point * (disparity / (disparity + errors.disparity)) - point;
  const SharedJacobian j = sharedJacobian(errors, kFocal, kBaseline, point);
  EXPECT_LT((j.col(3) - moved).norm(), 1e-3 * moved.norm());
}

}  // namespace
}  // namespace fathom::closure

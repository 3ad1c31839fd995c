#include "recon/geometry/se3.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "recon/geometry/uncertain_pose.hpp"

namespace fathom {
namespace {

Vector6d randomTwist(std::mt19937& random, double angle) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Vector6d twist;
  for (int i = 0; i < 6; ++i) twist(i) = uniform(random);
  twist.tail<3>() *= angle / twist.tail<3>().norm();
  return twist;
}

TEST(SE3, LogInvertsExpFromTinyAnglesToAlmostHalfATurn) {
  std::mt19937 random(1);
  for (const double angle : {1e-12, 1e-7, 1e-3, 0.5, 2.0, 3.1}) {
    for (int i = 0; i < 50; ++i) {
      const Vector6d twist = randomTwist(random, angle);
      EXPECT_LT((SE3::exp(twist).log() - twist).norm(), 1e-9) << "angle " << angle;
    }
  }
}

TEST(SE3, EulerAnglesGiveTheRotationBackAtAndNearAPitchOfAQuarterTurn) {
  for (const double sign : {1.0, -1.0}) {
    for (const double off : {0.0, 1e-12, 1e-10, 1e-8, 1e-3}) {
      const SE3 pose = SE3::fromEuler(0.3, sign * (std::numbers::pi / 2 - off), 0.8, Eigen::Vector3d::Zero());
      const Eigen::Vector3d e = pose.euler();
      const SE3 again = SE3::fromEuler(e.x(), e.y(), e.z(), Eigen::Vector3d::Zero());
      EXPECT_LT((again.inverse() * pose).log().norm(), 1e-7) << sign << " " << off;
    }
  }
}

TEST(SE3, ExpMatchesTheMatrixSeries) {
  std::mt19937 random(2);
  const Vector6d twist = randomTwist(random, 0.7);
  Eigen::Matrix4d generator = Eigen::Matrix4d::Zero();
  generator.block<3, 1>(0, 3) = twist.head<3>();
  const Eigen::Vector3d phi = twist.tail<3>();
  generator.block<3, 3>(0, 0) << 0, -phi.z(), phi.y(), phi.z(), 0, -phi.x(), -phi.y(), phi.x(), 0;
  Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = Eigen::Matrix4d::Identity();
  for (int k = 1; k < 30; ++k) {
    term = term * generator / k;
    sum += term;
  }
  const SE3 pose = SE3::exp(twist);
  EXPECT_LT((pose.matrix3() - sum.block<3, 3>(0, 0)).norm(), 1e-12);
  EXPECT_LT((pose.translation() - sum.block<3, 1>(0, 3)).norm(), 1e-12);
}

TEST(SE3, EulerAnglesRoundTripAndTurnAboutZThenYThenX) {
  const Eigen::Vector3d rpy(0.1, -0.4, 2.5);
  const SE3 pose = SE3::fromEuler(rpy.x(), rpy.y(), rpy.z(), Eigen::Vector3d(1, 2, 3));
  EXPECT_LT((pose.euler() - rpy).norm(), 1e-12);
  // A vehicle heading east (yaw 90 deg) has its bow towards +y of nav.
  const SE3 east = SE3::fromEuler(0, 0, std::numbers::pi / 2, Eigen::Vector3d::Zero());
  EXPECT_LT((east * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  // Nose up (positive pitch) raises the bow: negative z in North-East-Down.
  EXPECT_LT((SE3::fromEuler(0, 0.2, 0, Eigen::Vector3d::Zero()) * Eigen::Vector3d::UnitX()).z(), 0);
}

TEST(SE3, InverseAndCompositionCancel) {
  std::mt19937 random(3);
  const SE3 a = SE3::exp(randomTwist(random, 1.0)), b = SE3::exp(randomTwist(random, 2.0));
  EXPECT_LT(((a * b) * (b.inverse() * a.inverse())).log().norm(), 1e-12);
}

TEST(SE3, InterpolationHitsItsEndsAndHalvesTheDistance) {
  std::mt19937 random(4);
  const SE3 a = SE3::exp(randomTwist(random, 0.3)), b = SE3::exp(randomTwist(random, 1.2));
  EXPECT_LT((interpolate(a, b, 0).inverse() * a).log().norm(), 1e-12);
  EXPECT_LT((interpolate(a, b, 1).inverse() * b).log().norm(), 1e-12);
  EXPECT_LT((interpolate(a, b, 0.5).translation() - 0.5 * (a.translation() + b.translation())).norm(), 1e-12);
}

TEST(WrapAngle, StaysInTheHalfOpenTurn) {
  EXPECT_NEAR(wrapAngle(3 * std::numbers::pi), std::numbers::pi, 1e-12);
  EXPECT_NEAR(wrapAngle(-std::numbers::pi), std::numbers::pi, 1e-12);
  EXPECT_NEAR(wrapAngle(-0.1 - 4 * std::numbers::pi), -0.1, 1e-12);
}

UncertainPose known(const SE3& T, double sigma) {
  return {T, sigma * sigma * Matrix6d::Identity()};
}

TEST(UncertainPose, TwoClosuresOfNeighboursAgreeAsFarAsAllFourAreKnown) {
  const SE3 T_w_a = SE3::fromEuler(0.1, 0, 0.3, {1, 2, 10}),
            T_w_a2 = SE3::fromEuler(0, 0.1, 0.4, {1.5, 2, 10});
  const SE3 T_w_b = SE3::fromEuler(0, 0, 2.9, {1.2, 2.5, 10}),
            T_w_b2 = SE3::fromEuler(0, 0, 3, {0.7, 2.4, 10});
  const SE3 off = SE3::fromEuler(0, 0, 0.01, {0.05, 0, 0});
  const auto distance2 = [&](const SE3& wrong, double sigma) {
    return cycleDistance2(known(T_w_a.inverse() * T_w_b * wrong, sigma),
                          known(T_w_b.inverse() * T_w_b2, sigma), known(T_w_a.inverse() * T_w_a2, sigma),
                          known(T_w_a2.inverse() * T_w_b2, sigma));
  };
  EXPECT_LT(distance2({}, 0.01), 1e-12);
  EXPECT_GT(distance2(off, 0.005), 16.81);
  EXPECT_LT(distance2(off, 0.05), 16.81);
}

}  // namespace
}  // namespace fathom

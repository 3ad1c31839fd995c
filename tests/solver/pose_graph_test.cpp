#include "recon/solver/pose_graph.hpp"

#include <gtest/gtest.h>

#include <random>

namespace fathom::slam {
namespace {

SE3 randomPose(std::mt19937& random, double turn) {
  std::normal_distribution<double> normal;
  Vector6d twist;
  for (int i = 0; i < 6; ++i) twist(i) = (i < 3 ? 3.0 : turn) * normal(random);
  return SE3::exp(twist);
}

TEST(RelativePose, DerivativesAgreeWithDifferencesForAnyPosesAndErrors) {
  std::mt19937 random(7);
  for (int round = 0; round < 50; ++round) {
    RelativePose edge;
    edge.T_from_to = randomPose(random, 0.7);
    const SE3 from = randomPose(random, 0.7);
    // Errors from small to large, but for half turns, where the sign of the quaternion changes.
    const SE3 to = from * edge.T_from_to * randomPose(random, 0.02 * round);
    const RelativePoseLinear l = linearize(edge, from, to);
    EXPECT_LT((l.error - relativePoseError(edge, from, to)).norm(), 1e-12);
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      const Vector6d d = kStep * Vector6d::Unit(i);
      const Vector6d by_from = (relativePoseError(edge, perturbed(from, d), to) -
                                relativePoseError(edge, perturbed(from, -d), to)) /
                               (2 * kStep);
      const Vector6d by_to = (relativePoseError(edge, from, perturbed(to, d)) -
                              relativePoseError(edge, from, perturbed(to, -d))) /
                             (2 * kStep);
      EXPECT_LT((by_from - l.by_from.col(i)).norm(), 1e-7);
      EXPECT_LT((by_to - l.by_to.col(i)).norm(), 1e-7);
    }
  }
}

TEST(RelativePose, BothSignsOfAQuaternionMeanTheSameRotation) {
  std::mt19937 random(8);
  RelativePose edge;
  edge.T_from_to = randomPose(random, 1.0);
  const SE3 from = randomPose(random, 1.0), to = randomPose(random, 1.0);
  const Eigen::Quaterniond& q = to.rotation();
  const SE3 other(Eigen::Quaterniond(-q.w(), -q.x(), -q.y(), -q.z()), to.translation());
  EXPECT_LT((relativePoseError(edge, from, to) - relativePoseError(edge, from, other)).norm(), 1e-12);
}

}  // namespace
}  // namespace fathom::slam

#include "recon/geometry/uncertain_pose.hpp"

#include <gtest/gtest.h>

namespace fathom {
namespace {

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

#include "recon/navigation/dead_reckoning/position_anchor.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/heap_counter.hpp"

namespace fathom::nav {
namespace {

const Eigen::Vector2d kShift(12.0, -7.0);  // truth: nav - odom [m]

TEST(PositionAnchor, KnowsNothingBeforeTheFirstFix) {
  EXPECT_FALSE(PositionAnchor(0).estimate().has_value());
}

TEST(PositionAnchor, UsblFixesAverageOut) {
  PositionAnchor anchor(0);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.5);
  for (int i = 0; i < 100; ++i)
    anchor.add(FixKind::kUsbl, kShift + Eigen::Vector2d(noise(random), noise(random)), 0.5);
  const auto estimate = anchor.estimate();
  ASSERT_TRUE(estimate);
  EXPECT_LT((estimate->shift - kShift).norm(), 0.2);
  EXPECT_NEAR(estimate->sigma, 0.05, 0.005);
}

TEST(PositionAnchor, WhatUsblFixesShareDoesNotAverageOut) {
  PositionAnchor anchor(2.5);
  for (int i = 0; i < 100; ++i) anchor.add(FixKind::kUsbl, kShift, 0.5);
  EXPECT_NEAR(anchor.estimate()->sigma, std::hypot(2.5, 0.05), 1e-9);
  EXPECT_NEAR(anchor.estimate(FixKind::kUsbl)->sigma, 0.05, 1e-9);
  EXPECT_FALSE(anchor.estimate(FixKind::kGps));
  // A float of GPS then says more than all of them.
  anchor.add(FixKind::kGps, kShift + Eigen::Vector2d(2, 0), 1.0);
  const double share = 1 / (1 + 1 / (2.5 * 2.5 + 0.05 * 0.05));
  EXPECT_NEAR((anchor.estimate()->shift - kShift).x(), 2 * share, 1e-9);
}

TEST(PositionAnchor, ManyGpsFixesOfOneFloatAreWorthOne) {
  PositionAnchor anchor(0);
  for (int i = 0; i < 60; ++i) anchor.add(FixKind::kGps, kShift, 1.5);
  EXPECT_NEAR(anchor.estimate()->sigma, 1.5, 1e-9);
}

TEST(PositionAnchor, PreciseUsblOutweighsABiasedFloatOfGps) {
  PositionAnchor anchor(0);
  for (int i = 0; i < 60; ++i) anchor.add(FixKind::kGps, kShift + Eigen::Vector2d(1.5, 1.0), 1.5);
  for (int i = 0; i < 8; ++i) anchor.add(FixKind::kUsbl, kShift, 0.3);
  EXPECT_LT((anchor.estimate()->shift - kShift).norm(), 0.05);
}

TEST(PositionAnchor, GpsAloneServesUntilUsblSpeaks) {
  PositionAnchor anchor(0);
  anchor.add(FixKind::kGps, kShift, 2.0);
  EXPECT_LT((anchor.estimate()->shift - kShift).norm(), 1e-9);
  EXPECT_EQ(anchor.estimate()->usbl_used, 0);
}

TEST(PositionAnchor, WildFixesDoNotMoveIt) {
  PositionAnchor anchor(0);
  for (int i = 0; i < 20; ++i)
    anchor.add(FixKind::kUsbl, kShift + Eigen::Vector2d(0.1 * (i % 3 - 1), 0), 0.3);
  for (int i = 0; i < 5; ++i) anchor.add(FixKind::kUsbl, kShift + Eigen::Vector2d(80, -200), 0.3);
  EXPECT_LT((anchor.estimate()->shift - kShift).norm(), 0.1);
  EXPECT_EQ(anchor.estimate()->outliers, 5);
}

TEST(PositionAnchor, RefusesNonsenseAndCountsIt) {
  PositionAnchor anchor(0);
  anchor.add(FixKind::kGps, {std::nan(""), 0}, 1);
  anchor.add(FixKind::kGps, {0, 0}, -1);
  anchor.add(FixKind::kUsbl, {0, 0}, 1e6);
  EXPECT_FALSE(anchor.estimate().has_value());
  EXPECT_EQ(anchor.counters().refused, 3u);
}

TEST(PositionAnchor, ALongMissionStaysInItsMemoryAndIsSampledEvenly) {
  PositionAnchor anchor(0);
  constexpr int kFixes = 10 * PositionAnchor::kCapacity;
  const auto before = fathom::test::threadCost();
  // The difference drifts by 5 m over the mission: an even sample averages to the middle of it.
  for (int i = 0; i < kFixes; ++i)
    anchor.add(FixKind::kUsbl, kShift + Eigen::Vector2d(5.0 * i / kFixes, 0), 0.3);
  const auto estimate = anchor.estimate();
  EXPECT_EQ((fathom::test::threadCost() - before).heap_calls, 0u);
  EXPECT_NEAR(estimate->shift.x() - kShift.x(), 2.5, 0.1);
  EXPECT_LE(estimate->usbl_used, PositionAnchor::kCapacity);
}

TEST(PositionAnchor, TwoFixesThatDisagreeAreWorthNoMoreThanTheirDistance) {
  PositionAnchor anchor(0);
  anchor.add(FixKind::kUsbl, {-4.7, -3.9}, 0.24);
  const double alone = anchor.estimate()->sigma;
  anchor.add(FixKind::kUsbl, {-12.3, -3.9}, 0.24);
  EXPECT_GT(anchor.estimate()->sigma, 2.0);
  for (int k = 0; k < 8; ++k) anchor.add(FixKind::kUsbl, {-4.7 + 0.05 * k, -3.9 - 0.05 * k}, 0.24);
  EXPECT_LT(anchor.estimate()->sigma, alone);
  EXPECT_NEAR(anchor.estimate()->shift.x(), -4.5, 0.2);
}

TEST(PositionAnchor, AFixThatContradictsGpsIsInflated) {
  PositionAnchor anchor(0);
  for (int k = 0; k < 10; ++k) anchor.add(FixKind::kGps, {-4.9, -4.2}, 0.9);
  anchor.add(FixKind::kUsbl, {-12.3, -3.9}, 0.24);
  EXPECT_GT(anchor.estimate()->sigma, 1.0);
}

TEST(PositionAnchor, AFixIsAsWrongAsTheVehicleMayHaveDriftedSince) {
  PositionAnchor anchor(0);
  anchor.add(FixKind::kUsbl, kShift, 1.0, -10);
  EXPECT_NEAR(anchor.estimate(30, 0.3)->sigma, std::hypot(1.0, 0.3 * 40), 1e-9);
  anchor.add(FixKind::kUsbl, kShift + Eigen::Vector2d(8, 0), 1.0, 30);
  EXPECT_NEAR(anchor.estimate(30, 0.3)->shift.x(), kShift.x() + 8, 1e-9);
  EXPECT_NEAR(anchor.estimate(30, 0.3)->sigma, 1.0, 1e-9);
}

TEST(PositionAnchor, ALongFloatBeforeTheLaunchDoesNotOutvoteTheFixesOfIt) {
  PositionAnchor anchor(0);
  // Five minutes alongside, then towed off by 40 m in a minute.
  for (int t = -360; t < -60; ++t) anchor.add(FixKind::kGps, kShift - Eigen::Vector2d(40, 0), 2.0, t);
  for (int t = -60; t < 0; ++t) anchor.add(FixKind::kGps, kShift + Eigen::Vector2d(t * 40 / 60.0, 0), 2.0, t);
  const auto estimate = anchor.estimate(0, 0.3);
  // Fixes of the last seven seconds have the most weight: the vehicle was towed by 5 m meanwhile.
  EXPECT_LT((estimate->shift - kShift).norm(), 6.0);
  EXPECT_GT((anchor.estimate()->shift - kShift).norm(), 30);
}

}  // namespace
}  // namespace fathom::nav

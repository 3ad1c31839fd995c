#include "realtime/onboard/map/position_anchor.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fathom::onboard {
namespace {

constexpr double kNorth = 12.0, kEast = -7.0;  // true shift from odom to nav [m]

PositionFix fix(FixKind kind, double north_error, double east_error, double sigma, double odom_north) {
  PositionFix f;
  f.kind = kind;
  f.T_odom_sensor = SE3(Eigen::Quaterniond::Identity(), {odom_north, 0, 3});
  f.north_east = {odom_north + kNorth + north_error, kEast + east_error};
  f.sigma = sigma;
  return f;
}

TEST(PositionAnchor, KnowsNothingBeforeTheFirstFix) {
  EXPECT_FALSE(PositionAnchor().estimate().has_value());
  EXPECT_EQ(PositionAnchor().sigma(), 0.0);
}

TEST(PositionAnchor, AveragesFixesOfAMovingVehicle) {
  PositionAnchor anchor;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 1.5);
  for (int i = 0; i < 100; ++i) anchor.add(fix(FixKind::kGps, noise(random), noise(random), 1.5, 0.5 * i));
  const auto T = anchor.estimate();
  ASSERT_TRUE(T);
  EXPECT_NEAR(T->translation().x(), kNorth, 0.5);
  EXPECT_NEAR(T->translation().y(), kEast, 0.5);
  EXPECT_EQ(T->translation().z(), 0.0);
  EXPECT_NEAR(anchor.sigma(), 0.15, 0.01);
}

TEST(PositionAnchor, WildFixesDoNotMoveIt) {
  PositionAnchor anchor;
  for (int i = 0; i < 20; ++i) anchor.add(fix(FixKind::kUsbl, 0.1 * (i % 3 - 1), 0, 0.3, i));
  for (int i = 0; i < 5; ++i) anchor.add(fix(FixKind::kUsbl, 80, -200, 0.3, i));
  EXPECT_NEAR(anchor.estimate()->translation().x(), kNorth, 0.1);
  EXPECT_NEAR(anchor.estimate()->translation().y(), kEast, 0.1);
}

TEST(PositionAnchor, GpsOutranksUsbl) {
  PositionAnchor anchor;
  for (int i = 0; i < 10; ++i) anchor.add(fix(FixKind::kUsbl, 5, 5, 0.1, i));
  EXPECT_NEAR(anchor.estimate()->translation().x(), kNorth + 5, 1e-6);
  anchor.add(fix(FixKind::kGps, 0, 0, 2.0, 0));
  EXPECT_NEAR(anchor.estimate()->translation().x(), kNorth, 1e-6);
}

TEST(PositionAnchor, RefusesNonsenseAndCountsWhatItCannotKeep) {
  PositionAnchor anchor;
  anchor.add(fix(FixKind::kGps, std::nan(""), 0, 1, 0));
  anchor.add(fix(FixKind::kGps, 0, 0, -1, 0));
  EXPECT_FALSE(anchor.estimate().has_value());
  for (int i = 0; i < PositionAnchor::kCapacity + 10; ++i) anchor.add(fix(FixKind::kGps, 0, 0, 1, i));
  EXPECT_EQ(anchor.counters().refused, 12u);
  EXPECT_EQ(anchor.counters().gps, static_cast<std::uint64_t>(PositionAnchor::kCapacity) + 12);
}

}  // namespace
}  // namespace fathom::onboard

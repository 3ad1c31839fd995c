#include <gtest/gtest.h>
#include <proj.h>

#include <cstdio>
#include <numbers>
#include <random>

#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/tile_mesh.hpp"
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

// PROJ's transverse Mercator with the origin to the last digit.
Eigen::Vector2d byProj(const Geodetic& origin, const Geodetic& position) {
  char definition[200];
  std::snprintf(definition, sizeof definition, "+proj=tmerc +ellps=WGS84 +k=1 +lat_0=%.15g +lon_0=%.15g",
                origin.latitude / kRadiansPerDegree, origin.longitude / kRadiansPerDegree);
  PJ* pj = proj_create(PJ_DEFAULT_CTX, definition);
  const PJ_COORD xy = proj_trans(pj, PJ_FWD, proj_coord(position.longitude, position.latitude, 0, 0));
  proj_destroy(pj);
  return {xy.xy.y, xy.xy.x};
}

TEST(LocalTransverseMercator, AgreesWithProjWithinATenthOfAMillimetre) {
  for (const Geodetic origin :
       {Geodetic{-31.8 * kRadiansPerDegree, 115.4 * kRadiansPerDegree},
        Geodetic{36.5 * kRadiansPerDegree, 22.9 * kRadiansPerDegree},
        Geodetic{70.1 * kRadiansPerDegree, -179.99 * kRadiansPerDegree}, Geodetic{0.0, 0.0}}) {
    const LocalTransverseMercator local(origin);
    for (const double d_lat : {-0.3, 0.0, 0.001, 0.2}) {
      for (const double d_lon : {-0.4, 0.0, 0.002, 0.3}) {
        Geodetic p{origin.latitude + d_lat * kRadiansPerDegree, origin.longitude + d_lon * kRadiansPerDegree};
        EXPECT_LT((local.toLocal(p) - byProj(origin, p)).norm(), 1e-4) << d_lat << ' ' << d_lon;
      }
    }
  }
}

TEST(LocalTransverseMercator, RoundTripsToMicrometres) {
  const LocalTransverseMercator local({-31.8 * kRadiansPerDegree, 115.4 * kRadiansPerDegree});
  for (const Eigen::Vector2d& p :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(1234.5, -987.6), Eigen::Vector2d(-40e3, 60e3)})
    EXPECT_LT((local.toLocal(local.toGeodetic(p)) - p).norm(), 1e-6);
}

TEST(LocalTransverseMercator, RefusesAnOriginOffTheGlobe) {
  EXPECT_THROW(LocalTransverseMercator({2.0, 0.0}), std::runtime_error);
  EXPECT_THROW(LocalTransverseMercator({0.5, 4.0}), std::runtime_error);
}

TEST(TileGrid, ParentCoversFourByFourChildrenOnEitherSideOfTheOrigin) {
  for (int x = -9; x <= 9; ++x) {
    const TileId up = TileGrid::parent({0, x, -x});
    EXPECT_EQ(up.level, 1);
    EXPECT_LE(4 * up.x, x);
    EXPECT_LT(x, 4 * up.x + 4);
    EXPECT_LE(4 * up.y, -x);
    EXPECT_LT(-x, 4 * up.y + 4);
  }
}

TEST(TileGrid, FindsTheTileOfAPlaceAtEveryLevel) {
  const TileGrid grid;
  for (int level = 0; level < 4; ++level) {
    const TileId tile = grid.at(level, -7.3, 1234.5);
    const auto box = grid.box(tile);
    EXPECT_LE(box[0], -7.3);
    EXPECT_GT(box[2], -7.3);
    EXPECT_LE(box[1], 1234.5);
    EXPECT_GT(box[3], 1234.5);
  }
}

TEST(TileGrid, LatticeIsExactInSinglePrecisionUpToEightKilometres) {
  for (const double value : {0.0331, -8191.99, 1234.56789}) {
    const double snapped = TileGrid::snap(value);
    EXPECT_NEAR(snapped, value, TileGrid::kLattice / 2);
    EXPECT_EQ(static_cast<double>(static_cast<float>(snapped)), snapped);
  }
}

}  // namespace
}  // namespace fathom

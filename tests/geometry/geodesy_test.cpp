#include "recon/geometry/geodesy.hpp"

#include <gtest/gtest.h>
#include <proj.h>

#include <cstdio>
#include <numbers>

namespace fathom {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

// PROJ's transverse Mercator with the origin to the last digit.
Eigen::Vector2d byProj(const Geodetic& origin, const Geodetic& position) {
  char definition[200];
  std::snprintf(definition, sizeof definition, "+proj=tmerc +ellps=WGS84 +k=1 +lat_0=%.15g +lon_0=%.15g",
                origin.latitude / kDegree, origin.longitude / kDegree);
  PJ* pj = proj_create(PJ_DEFAULT_CTX, definition);
  const PJ_COORD xy = proj_trans(pj, PJ_FWD, proj_coord(position.longitude, position.latitude, 0, 0));
  proj_destroy(pj);
  return {xy.xy.y, xy.xy.x};
}

TEST(LocalTransverseMercator, AgreesWithProjWithinATenthOfAMillimetre) {
  for (const Geodetic origin :
       {Geodetic{-31.8 * kDegree, 115.4 * kDegree}, Geodetic{36.5 * kDegree, 22.9 * kDegree},
        Geodetic{70.1 * kDegree, -179.99 * kDegree}, Geodetic{0.0, 0.0}}) {
    const LocalTransverseMercator local(origin);
    for (const double d_lat : {-0.3, 0.0, 0.001, 0.2}) {
      for (const double d_lon : {-0.4, 0.0, 0.002, 0.3}) {
        Geodetic p{origin.latitude + d_lat * kDegree, origin.longitude + d_lon * kDegree};
        EXPECT_LT((local.toLocal(p) - byProj(origin, p)).norm(), 1e-4) << d_lat << ' ' << d_lon;
      }
    }
  }
}

TEST(LocalTransverseMercator, RoundTripsToMicrometres) {
  const LocalTransverseMercator local({-31.8 * kDegree, 115.4 * kDegree});
  for (const Eigen::Vector2d& p :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(1234.5, -987.6), Eigen::Vector2d(-40e3, 60e3)})
    EXPECT_LT((local.toLocal(local.toGeodetic(p)) - p).norm(), 1e-6);
}

TEST(LocalTransverseMercator, RefusesAnOriginOffTheGlobe) {
  EXPECT_THROW(LocalTransverseMercator({2.0, 0.0}), std::runtime_error);
  EXPECT_THROW(LocalTransverseMercator({0.5, 4.0}), std::runtime_error);
}

}  // namespace
}  // namespace fathom

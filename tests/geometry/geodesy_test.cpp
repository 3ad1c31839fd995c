#include "recon/geometry/geodesy.hpp"

#include <gtest/gtest.h>
#include <proj.h>

#include <cstdio>

#include "realtime/base/units.hpp"

namespace fathom {
namespace {

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

}  // namespace
}  // namespace fathom

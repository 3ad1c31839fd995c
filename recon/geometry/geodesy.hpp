#pragma once

#include <Eigen/Core>

namespace fathom {

struct Geodetic {
  double latitude = 0;   // [rad], WGS84
  double longitude = 0;  // [rad], WGS84
};

// Local transverse Mercator on WGS84 centred on an origin, scale 1: the nav frame's north and east [m]. Both
// come from Krueger's series (third flattening to the fourth order, well below a millimetre within 100 km),
// which needs no library and allocates nothing. The constructor checks it against PROJ and throws
// std::runtime_error if they differ.
class LocalTransverseMercator {
 public:
  explicit LocalTransverseMercator(const Geodetic& origin);

  // (north, east) [m] of a position.
  [[nodiscard]] Eigen::Vector2d toLocal(const Geodetic& position) const;
  [[nodiscard]] Geodetic toGeodetic(const Eigen::Vector2d& north_east) const;
  [[nodiscard]] const Geodetic& origin() const { return origin_; }

 private:
  Geodetic origin_;
  double origin_northing_ = 0;  // of the origin's latitude, before centring [m]
};

// Convergence of the meridian [rad] at `east` of the origin [m], near a latitude [rad]: the angle from true
// north to nav's north, clockwise, so that grid heading = true heading - convergence. East over the radius
// of curvature in the prime vertical, times the latitude's tangent (Snyder 1987, "Map projections", USGS
// professional paper 1395, eq. 8-15, first order): to 1e-5 rad within 100 km below 70 degrees.
[[nodiscard]] double meridianConvergence(double east, double latitude) noexcept;

// Zone of UTM, 1 to 60, at a longitude of -180 to 180 degrees [rad]; 180 degrees is in zone 1.
[[nodiscard]] int utmZone(double longitude) noexcept;

}  // namespace fathom

#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"

namespace fathom::compare {

// A rectangle of a plane frame [m].
struct Box {
  double west = 0, south = 0, east = 0, north = 0;
  [[nodiscard]] bool empty() const { return !(west < east && south < north); }
};

// Coordinate reference system of eastings and northings [m], as WKT; empty: unknown.
struct PlaneFrame {
  std::string wkt;
  [[nodiscard]] bool known() const { return !wkt.empty(); }
};

// The nav frame of a mission: transverse Mercator on WGS84 about its origin.
[[nodiscard]] PlaneFrame localFrame(const Geodetic& origin);
// From text of a user or a file: "EPSG:32756", WKT, a PROJ string. Throws InputError(where).
[[nodiscard]] PlaneFrame frameFrom(const std::string& definition, const std::string& where);
// True for a frame in degrees.
[[nodiscard]] bool isGeographic(const PlaneFrame& frame);

// Points from one frame to another, longitude before latitude; heights are left as they are. Identity where
// one of the frames is unknown or both are the same.
class PlaneTransform {
 public:
  PlaneTransform(const PlaneFrame& from, const PlaneFrame& to);
  ~PlaneTransform();
  PlaneTransform(const PlaneTransform&) = delete;
  PlaneTransform& operator=(const PlaneTransform&) = delete;

  // In place. Points that cannot be transformed become NaN.
  void apply(std::vector<double>& x, std::vector<double>& y) const;
  // The box around a box.
  [[nodiscard]] Box apply(const Box& box) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;  // null: identity
};

}  // namespace fathom::compare

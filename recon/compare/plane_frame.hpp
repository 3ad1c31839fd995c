#pragma once

#include <Eigen/Core>
#include <cstddef>
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

// Heights (up, [m]) in square cells of a plane frame; the first row is the northernmost. NaN: unknown.
struct HeightMap {
  double west = 0, north = 0;  // of the top left corner [m]
  double cell = 1;             // [m]
  int columns = 0, rows = 0;
  std::vector<float> up;
  std::vector<float> sigma;  // standard deviation of `up`; empty if unknown

  HeightMap() = default;
  // All unknown; covers the box, with cell borders at multiples of the cell.
  HeightMap(const Box& box, double cell_m);

  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  [[nodiscard]] double eastOf(int column) const { return west + (column + 0.5) * cell; }
  [[nodiscard]] double northOf(int row) const { return north - (row + 0.5) * cell; }
  [[nodiscard]] Box box() const { return {west, north - rows * cell, west + columns * cell, north}; }
  [[nodiscard]] std::size_t known() const;
  // Between the four cells around a place; NaN where one of them is unknown.
  [[nodiscard]] double at(double east, double north_m) const;

  // Means of factor x factor cells, where at least half of them are known.
  [[nodiscard]] HeightMap coarser(int factor) const;
};

// The median of the known heights; NaN without any.
[[nodiscard]] double medianHeight(const HeightMap& map);

}  // namespace fathom::compare

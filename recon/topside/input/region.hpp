#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <optional>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// The part of the seafloor that is modelled: polygons, with holes or without.
class Region {
 public:
  // All polygons of a file of any vector format that GDAL reads (GeoJSON, GeoPackage, shapefile). `origin`:
  // of nav on Earth; none: coordinates are east and north in nav [m]. Throws InputError for a file that
  // cannot be read or has no polygon, and for one without the coordinate reference system that a dive on
  // Earth needs.
  Region(const std::filesystem::path& file, const std::optional<Geodetic>& origin);

  [[nodiscard]] bool contains(double north, double east) const;
  // False where a box of north and east [m] is outside for sure.
  [[nodiscard]] bool mayMeet(const Eigen::AlignedBox2d& box) const;
  [[nodiscard]] double area() const;              // [m2]
  [[nodiscard]] Eigen::AlignedBox2d box() const;  // around all of it
  [[nodiscard]] const Digest& identity() const { return identity_; }

  // The triangles whose middles are inside, and their vertices.
  [[nodiscard]] TileMesh inside(const TileMesh& tile) const;

 private:
  using Ring = std::vector<Eigen::Vector2d>;  // north, east [m]
  struct Polygon {
    std::vector<Ring> rings;  // the outer one, then holes
    Eigen::AlignedBox2d box;
  };
  std::vector<Polygon> polygons_;
  Digest identity_;
};

}  // namespace fathom::topside

#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// How far a camera saw through empty water: a coarse picture, from the camera centre, of the depth along the
// view's axis before which nothing was met. Cautious: a cell holds the least depth of all triangles near it,
// and cells next to one without triangles hold none.
class SightMap {
 public:
  // Lays the picture over the mesh's vertices that triangles use.
  SightMap(const Mesh& mesh, const Eigen::Vector3d& centre);

  // A triangle (corners relative to the centre) that begins `band` [m] before its surface; `weight` [1/m^2].
  void add(const std::array<Eigen::Vector3d, 3>& corner, double band, double weight);
  // Call after the last add().
  void close();

  // Weight with which a point (relative to the centre) is known to be empty; 0: not known.
  [[nodiscard]] double emptyWeight(const Eigen::Vector3d& point) const;

  // Box of all that is seen, relative to the centre, down from the centre or up to it [m].
  [[nodiscard]] const Eigen::Vector3d& low() const { return low_; }
  [[nodiscard]] const Eigen::Vector3d& high() const { return high_; }

 private:
  static constexpr int kSize = 64;  // cells a side: some ten points' spacing of a frame of 800 points
  struct Cell {
    double depth = 0, weight = 0;  // [m], [1/m^2]
    bool seen = false;
  };
  [[nodiscard]] Eigen::Vector2d cellOf(const Eigen::Vector3d& in_view) const {
    return (in_view.head<2>() / in_view.z() - origin_) * scale_;
  }

  Eigen::Matrix3d view_;  // rows: right, down, forward
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  double scale_ = 0;  // cells per unit of x / z
  Eigen::Vector3d low_, high_;
  std::vector<Cell> cells_;
};

}  // namespace fathom::fusion

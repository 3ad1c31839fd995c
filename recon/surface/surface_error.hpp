#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::surface {

// Nearest point of a triangle mesh, by a grid of its triangles. Keeps a reference to the mesh.
class NearestTriangle {
 public:
  explicit NearestTriangle(const Mesh& mesh);  // with at least one triangle

  struct Hit {
    std::uint32_t triangle = 0;
    double squared = 0;  // distance [m^2]
  };
  // `start`: a triangle that may be near, from which the search begins.
  [[nodiscard]] Hit operator()(const Eigen::Vector3d& point, std::uint32_t start = 0) const;
  [[nodiscard]] double squaredDistance(const Eigen::Vector3d& point, std::uint32_t triangle) const;

 private:
  [[nodiscard]] Eigen::Array3i cellOf(const Eigen::Vector3d& point) const;

  const Mesh& mesh_;
  Eigen::Vector3d low_;
  double cell_ = 1;
  Eigen::Array3i size_;
  std::vector<std::uint32_t> first_, triangles_;  // of each cell
};

// Bound of the greatest distance from any point of `from` to `to` [m]: never less, and more by at most
// `tolerance` or a twentieth. Over a triangle the distance to one flat face is greatest at a corner; where
// the corners of a triangle are nearest to different faces it is divided until that decides.
[[nodiscard]] double distanceBound(const Mesh& from, const Mesh& to, double tolerance);

}  // namespace fathom::surface

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::surface {

// Upper bound of the greatest distance from any point of `from` to `to` [m], usually too large by at most
// `tolerance` or a twentieth. Each triangle is cut into the parts over one face of `to` each (walking from
// face to face); the distance to a face is convex, so that over such a part it is greatest at a corner. A
// part with a large bound is divided until its nearest faces decide. 0 if `from` is empty, infinite if only
// `to` is.
[[nodiscard]] double distanceBound(const Mesh& from, const Mesh& to, double tolerance);

// Squared distance of p to the triangle abc (Ericson, Real-Time Collision Detection, 5.1.5).
[[nodiscard]] double squaredToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                       const Eigen::Vector3d& b, const Eigen::Vector3d& c);

// Nearest triangle of a mesh, by a grid of its triangles. Keeps a reference to the mesh.
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
  [[nodiscard]] std::size_t number(int x, int y, int z) const {
    return (static_cast<std::size_t>(x) * static_cast<std::size_t>(size_.y()) + static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(size_.z()) +
           static_cast<std::size_t>(z);
  }
  void forCells(std::size_t triangle, const auto& visit) const;
  void search(std::size_t cell, const Eigen::Vector3d& point, Hit& best) const;

  const Mesh& mesh_;
  Eigen::Vector3d low_;
  double cell_ = 1;
  Eigen::Array3i size_;
  std::vector<std::uint32_t> first_, triangles_;  // of each cell
};

}  // namespace fathom::surface

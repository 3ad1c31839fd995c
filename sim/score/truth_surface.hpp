#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "recon/geometry/mesh.hpp"

namespace fathom::sim {

// The true surface with nearest-point and ray queries (Embree). Thread-safe.
class TruthSurface {
 public:
  // Throws std::invalid_argument for a mesh without triangles.
  explicit TruthSurface(Mesh mesh);
  ~TruthSurface();
  TruthSurface(const TruthSurface&) = delete;
  TruthSurface& operator=(const TruthSurface&) = delete;

  struct Nearest {
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, of its triangle
    double distance = 0;                               // [m]
    Eigen::Vector3d linear = Eigen::Vector3d::Zero();  // albedo, red, green, blue; zero without colours
  };
  // The nearest point on any triangle.
  [[nodiscard]] Nearest nearest(const Eigen::Vector3d& from) const;
  // First hit of a ray.
  [[nodiscard]] std::optional<Eigen::Vector3d> castRay(const Eigen::Vector3d& from,
                                                       const Eigen::Vector3d& direction) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim

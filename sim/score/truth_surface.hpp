#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"

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

using Points = std::vector<Eigen::Vector3d>;

// The rigid motion T_truth_estimate that takes `estimate` nearest to `truth`, point by point (Umeyama 1991,
// without scale). Identity without points.
[[nodiscard]] SE3 alignRigid(const Points& estimate, const Points& truth);
// The same with rotation about the vertical only, which is well-conditioned for points near a line.
[[nodiscard]] SE3 alignLevel(const Points& estimate, const Points& truth);

// The rigid motion that takes points of an estimated surface onto the true one: point-to-plane ICP from
// `start`, rejecting points farther away than three times the median distance. Never worse than the start.
[[nodiscard]] SE3 alignSurface(const Points& estimate, const TruthSurface& truth, const SE3& start);

}  // namespace fathom::sim

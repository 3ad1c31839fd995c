#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::test {

// Distance of points to a triangle mesh, by a grid of its triangles.
class SurfaceDistance {
 public:
  SurfaceDistance(const Mesh& mesh, float cell) : mesh_(mesh), cell_(cell) {
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      Eigen::Array3f low = corner(t, 0), high = low;
      for (int k = 1; k < 3; ++k) {
        low = low.min(corner(t, k).array());
        high = high.max(corner(t, k).array());
      }
      const Eigen::Array3i a = (low / cell_).floor().cast<int>(), b = (high / cell_).floor().cast<int>();
      for (int x = a.x(); x <= b.x(); ++x)
        for (int y = a.y(); y <= b.y(); ++y)
          for (int z = a.z(); z <= b.z(); ++z) cells_[{x, y, z}].push_back(t);
    }
  }

  // Up to one cell; more than that is one cell.
  float operator()(const Eigen::Vector3f& p) const {
    float best = cell_;
    const Eigen::Array3i at = (p.array() / cell_).floor().cast<int>();
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dz = -1; dz <= 1; ++dz) {
          const auto found = cells_.find({at.x() + dx, at.y() + dy, at.z() + dz});
          if (found == cells_.end()) continue;
          for (const std::size_t t : found->second) best = std::min(best, distance(p, t));
        }
    return best;
  }

 private:
  Eigen::Vector3f corner(std::size_t t, int k) const {
    return mesh_.vertices[mesh_.triangles[t][static_cast<std::size_t>(k)]];
  }
  float distance(const Eigen::Vector3f& p, std::size_t t) const {
    const Eigen::Vector3f a = corner(t, 0), b = corner(t, 1), c = corner(t, 2);
    const Eigen::Vector3f n = (b - a).cross(c - a);
    const float area2 = n.squaredNorm();
    float best = std::min({segment(p, a, b), segment(p, b, c), segment(p, c, a)});
    if (area2 > 0) {
      const bool inside = n.dot((b - a).cross(p - a)) >= 0 && n.dot((c - b).cross(p - b)) >= 0 &&
                          n.dot((a - c).cross(p - c)) >= 0;
      if (inside) best = std::min(best, std::abs(n.dot(p - a)) / std::sqrt(area2));
    }
    return best;
  }
  static float segment(const Eigen::Vector3f& p, const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
    const Eigen::Vector3f d = b - a;
    const float s = d.squaredNorm() > 0 ? std::clamp((p - a).dot(d) / d.squaredNorm(), 0.0F, 1.0F) : 0.0F;
    return (p - a - s * d).norm();
  }

  const Mesh& mesh_;
  float cell_;
  std::map<std::array<int, 3>, std::vector<std::size_t>> cells_;
};

}  // namespace fathom::test

#include "recon/geometry/pose_variance.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace fathom {

void addPoseVariance(std::span<const UncertainView> views, Mesh& mesh) {
  if (views.empty()) return;
  const auto north = [&mesh](std::uint32_t v) { return static_cast<double>(mesh.vertices[v].x()); };
  std::vector<std::uint32_t> northward(mesh.vertices.size());
  std::iota(northward.begin(), northward.end(), 0U);
  std::ranges::sort(northward, {}, north);
  struct Mean {
    float sum = 0, count = 0;
  };
  std::vector<Mean> added(mesh.vertices.size());
  for (const UncertainView& view : views) {
    const auto& [low_north, low_east, high_north, high_east] = view.box;
    const SE3 T_cam_nav = view.T_nav_cam.inverse();
    const Eigen::Matrix3d R_cam_nav = T_cam_nav.matrix3();
    for (auto v = std::ranges::lower_bound(northward, low_north, {}, north);
         v != northward.end() && north(*v) <= high_north; ++v) {
      const Eigen::Vector3d at = mesh.vertices[*v].cast<double>();
      if (at.y() < low_east || at.y() > high_east) continue;
      const Eigen::Vector3d normal = R_cam_nav * mesh.normals[*v].cast<double>();
      Vector6d row;
      row << normal, (T_cam_nav * at).cross(normal);
      added[*v].sum += static_cast<float>(row.dot(view.covariance * row));
      added[*v].count += 1;
    }
  }
  for (std::size_t v = 0; v < added.size(); ++v)
    if (added[v].count > 0)
      mesh.sigma[v] = std::sqrt(mesh.sigma[v] * mesh.sigma[v] + added[v].sum / added[v].count);
}

}  // namespace fathom

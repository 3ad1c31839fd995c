#include "recon/topside/pieces/pose_variance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace fathom::topside {
namespace {

using Box = std::array<double, 4>;  // as MeshFootprint's

bool meet(const Box& a, const Box& b) {
  return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

Box boxOf(const Mesh& mesh) {
  Box box{INFINITY, INFINITY, -INFINITY, -INFINITY};
  for (const Eigen::Vector3f& p : mesh.vertices)
    for (std::size_t k = 0; k < 2; ++k) {
      const auto at = static_cast<double>(p[static_cast<int>(k)]);
      box[k] = std::min(box[k], at), box[k + 2] = std::max(box[k + 2], at);
    }
  return box;
}

}  // namespace

const Matrix6d& PoseVariance::nearest(std::uint32_t pair) const {
  const auto after = std::lower_bound(uncertain_.begin(), uncertain_.end(), pair,
                                      [](const auto& u, std::uint32_t p) { return u.pair < p; });
  if (after == uncertain_.begin()) return after->covariance;
  const auto before = after - 1;
  const bool later = after != uncertain_.end() && after->pair - pair < pair - before->pair;
  return (later ? after : before)->covariance;
}

void PoseVariance::addTo(Mesh& mesh, const std::vector<std::uint32_t>& pairs,
                         const std::vector<SE3>& T_nav_cam,
                         const std::vector<fusion::MeshFootprint>& footprints) const {
  if (uncertain_.empty() || mesh.empty()) return;
  const Box whole = boxOf(mesh);
  std::vector<double> sum(mesh.vertices.size()), count(mesh.vertices.size());
  for (const std::uint32_t pair : pairs) {
    const Box& box = footprints[pair].box;
    if (!meet(box, whole)) continue;
    const Matrix6d& covariance = nearest(pair);
    const SE3 T_cam_nav = T_nav_cam[pair].inverse();
    const Eigen::Matrix3d R_cam_nav = T_cam_nav.matrix3();
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
      const Eigen::Vector3d at = mesh.vertices[v].cast<double>();
      if (!meet(box, {at.x(), at.y(), at.x(), at.y()})) continue;
      const Eigen::Vector3d normal = R_cam_nav * mesh.normals[v].cast<double>();
      Vector6d row;
      row << normal, (T_cam_nav * at).cross(normal);
      sum[v] += row.dot(covariance * row);
      count[v] += 1;
    }
  }
  for (std::size_t v = 0; v < sum.size(); ++v)
    if (count[v] > 0)
      mesh.sigma[v] = static_cast<float>(std::sqrt(
          static_cast<double>(mesh.sigma[v]) * static_cast<double>(mesh.sigma[v]) + sum[v] / count[v]));
}

void PoseVariance::addKey(Hasher& hasher, std::uint32_t pair) const {
  if (uncertain_.empty()) return;
  const Matrix6d& covariance = nearest(pair);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column <= row; ++column) hasher.add(covariance(row, column));
}

}  // namespace fathom::topside

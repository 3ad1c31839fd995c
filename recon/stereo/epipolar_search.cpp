#include "recon/stereo/epipolar_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "recon/geometry/se3.hpp"

namespace fathom::stereo {

EpipolarSearch::EpipolarSearch(const Camera& to, const SE3& T_to_from, double step, double radius,
                               double min_range, double max_range)
    : to_(to),
      rotation_(T_to_from.matrix3()),
      translation_(T_to_from.translation()),
      step_(step),
      radius_(radius),
      nearest_(1.0 / min_range),
      farthest_(1.0 / max_range) {
  candidates_.reserve(2 * static_cast<std::size_t>(radius / step) + 3);
}

void EpipolarSearch::look(const Camera& to, const SE3& T_to_from) {
  to_ = to;
  rotation_ = T_to_from.matrix3();
  translation_ = T_to_from.translation();
}

double EpipolarSearch::seedInverseDepth(const Eigen::Vector3d& ray, const ViewPlane& plane) const {
  // z of the intersection is distance / (normal . ray).
  const double inverse_depth = plane.normal.dot(ray) / plane.distance;
  return std::isfinite(inverse_depth) ? std::clamp(inverse_depth, farthest_, nearest_) : farthest_;
}

bool EpipolarSearch::project(const Eigen::Vector3d& rotated_ray, double inverse_depth,
                             Eigen::Vector2d& pixel) const {
  if (!(rotated_ray.z() + inverse_depth * translation_.z() > 0)) return false;
  pixel = projectAt(to_, rotated_ray, translation_, inverse_depth);
  return true;
}

bool EpipolarSearch::seed(const Eigen::Vector3d& ray, const ViewPlane& plane, double margin,
                          Eigen::Vector2d& pixel) const {
  return project(rotation_ * ray, seedInverseDepth(ray, plane), pixel) && to_.contains(pixel, margin);
}

const std::vector<Eigen::Vector2d>& EpipolarSearch::candidates(const Eigen::Vector3d& ray,
                                                               const ViewPlane& plane) {
  candidates_.clear();
  const Eigen::Vector3d rotated = rotation_ * ray;
  const double seed = seedInverseDepth(ray, plane);
  // Disparity is linear in inverse depth but for the distortion. Pixels for one unit of inverse depth:
  Eigen::Vector2d a, b;
  const double small = 1e-3 * farthest_;  // [1/m]
  if (!project(rotated, seed, a) || !project(rotated, seed + small, b)) return candidates_;
  const double pixels = (b - a).norm() / small;
  if (!(pixels > 0)) return candidates_;
  const int steps = static_cast<int>(radius_ / step_);
  for (int k = -steps; k <= steps; ++k) {
    const double inverse_depth = seed + k * step_ / pixels;
    // One step of margin: the true position may be between the range limit and the last candidate within it.
    if (inverse_depth < farthest_ - step_ / pixels || inverse_depth > nearest_ + step_ / pixels) continue;
    if (project(rotated, inverse_depth, a) && to_.contains(a)) candidates_.push_back(a);
  }
  return candidates_;
}

EpipolarDistance::EpipolarDistance(const StereoRig& rig) : focal_(0.5 * (rig.right.fx + rig.right.fy)) {
  const Eigen::Vector3d& t = rig.T_right_left.translation();
  essential_ = crossMatrix(t) * rig.T_right_left.matrix3();
}

EpipolarDistance::Offset EpipolarDistance::offset(const Eigen::Vector3d& left_ray,
                                                  const Eigen::Vector3d& right_ray) const {
  const Eigen::Vector3d line = essential_ * left_ray;
  const double norm = line.head<2>().norm();
  return {line.dot(right_ray) / norm * focal_, line.head<2>() / norm};
}

double EpipolarDistance::operator()(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray) const {
  return std::abs(offset(left_ray, right_ray).distance);
}

}  // namespace fathom::stereo

#include "recon/stereo/local_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "recon/geometry/image_view.hpp"

namespace fathom::stereo {
namespace {

bool isSurface(const SparseStereoConfig& limits, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
               const Eigen::Vector3d& c) {
  const double longest = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
  if (longest > limits.max_edge * limits.max_edge) return false;
  const Eigen::Vector3d normal = (b - a).cross(c - a), sight = a + b + c;
  return std::abs(normal.dot(sight)) > std::cos(limits.max_slope) * normal.norm() * sight.norm();
}

// Checks the triangle's middle and those of its sides.
bool spansHidden(const ImageMask& mask, const Eigen::Vector2f& a, const Eigen::Vector2f& b,
                 const Eigen::Vector2f& c) {
  for (const Eigen::Vector2f& at : {Eigen::Vector2f((a + b + c) / 3), Eigen::Vector2f((a + b) / 2),
                                    Eigen::Vector2f((b + c) / 2), Eigen::Vector2f((c + a) / 2)})
    if (mask.hides(at.cast<double>())) return true;
  return false;
}

}  // namespace

LocalMesh::LocalMesh(std::size_t max_points) : delaunay_(max_points), consistency_(max_points) {
  pixels_.reserve(max_points);
  verdicts_.reserve(max_points);
}

const std::vector<Delaunay::Triangle>& LocalMesh::triangulatePixels(const StereoResult& result) {
  pixels_.clear();
  for (const StereoPoint& p : result.points)
    pixels_.push_back({std::max(0, static_cast<std::int32_t>(std::lround(p.left.x()))),
                       std::max(0, static_cast<std::int32_t>(std::lround(p.left.y())))});
  return delaunay_.triangulate(pixels_);
}

void LocalMesh::dropOutliers(const SparseStereoConfig& limits, StereoResult& result) {
  using Verdict = DepthConsistency::Verdict;
  consistency_.check({limits.max_slope, limits.min_patch_points, limits.max_fish_length}, result.points,
                     triangulatePixels(result), verdicts_);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < verdicts_.size(); ++i) {
    if (verdicts_[i] == Verdict::kKeep)
      result.points[kept++] = result.points[i];
    else
      ++(verdicts_[i] == Verdict::kFish ? result.rejected.fish : result.rejected.outlier);
  }
  result.points.resize(kept);
}

void LocalMesh::triangulate(const SparseStereoConfig& limits, StereoResult& result, const ImageMask* mask) {
  result.triangles.clear();
  const auto at = [&](std::uint32_t i) { return result.points[i].point.cast<double>(); };
  const auto pixel = [&](std::uint32_t i) -> const Eigen::Vector2f& { return result.points[i].left; };
  for (const Delaunay::Triangle& t : triangulatePixels(result)) {
    if (!isSurface(limits, at(t[0]), at(t[1]), at(t[2]))) continue;
    if (mask != nullptr && spansHidden(*mask, pixel(t[0]), pixel(t[1]), pixel(t[2]))) continue;
    // Reversed: counter-clockwise for the camera (y is down in its image).
    result.triangles.push_back({t[0], t[2], t[1]});
  }
}

}  // namespace fathom::stereo

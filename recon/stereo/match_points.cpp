#include "recon/stereo/match_points.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/stereo/midpoint_triangulation.hpp"

namespace fathom::stereo {
namespace {

bool fits(const ImageView& image, const Camera& camera) {
  return !image.empty() && image.format == PixelFormat::kMono && image.bits == 8 &&
         image.width == camera.width && image.height == camera.height &&
         image.stride >= static_cast<std::size_t>(image.width);
}

bool usable(const SeedPlane& plane) {
  return plane.normal.allFinite() && std::isfinite(plane.distance) && plane.distance > 0 &&
         plane.normal.norm() > 0.5;
}

}  // namespace

MatchNoise::MatchNoise(std::size_t max_matches) {
  matches_.reserve(max_matches);
  ratios_.reserve(max_matches);
}

void MatchNoise::clear() {
  matches_.clear();
}

void MatchNoise::add(const EpipolarDistance::Offset& offset, const Eigen::Matrix2d& covariance) {
  const double variance = offset.normal.dot(covariance * offset.normal) + kPixelFloor * kPixelFloor;
  matches_.push_back({offset.distance, std::sqrt(variance)});
}

double MatchNoise::scale() {
  if (matches_.size() < kMinMatches) return kUsual;
  ratios_.clear();
  for (std::size_t i = 1; i < matches_.size(); ++i) {
    const Match &a = matches_[i - 1], &b = matches_[i];
    ratios_.push_back(std::abs(a.distance - b.distance) / std::hypot(a.sigma, b.sigma));
  }
  return std::max(kLeast, kMadToSigma * median(std::span(ratios_)));
}

void MatchNoise::widen(StereoResult& result) {
  result.noise_scale = static_cast<float>(scale());
  for (StereoPoint& p : result.points) {
    p.sigma_z *= result.noise_scale;
    for (float& c : p.covariance) c *= result.noise_scale * result.noise_scale;
  }
}

MatchPoints::MatchPoints(const StereoRig& rig, std::size_t max_points)
    : rig_(rig), epipolar_(rig), triangulation_(rig), noise_(max_points) {}

void MatchPoints::setRig(const StereoRig& rig) {
  rig_ = rig;
  epipolar_ = EpipolarDistance(rig);
  triangulation_ = MidpointTriangulation(rig);
}

void MatchPoints::begin(StereoResult& result) {
  result.matches.clear();
  result.points.clear();
  result.triangles.clear();
  result.rejected = {};
  result.corners = 0;
  noise_.clear();
  left_mask_ = right_mask_ = nullptr;
}

bool MatchPoints::begin(const ImageView& left, const ImageView& right, const SeedPlane& plane,
                        StereoResult& result) {
  begin(result);
  left_mask_ = left.mask;
  right_mask_ = right.mask;
  return fits(left, rig_.left) && fits(right, rig_.right) && usable(plane);
}

bool MatchPoints::showsGround(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                              const Eigen::Vector2d& right, StereoResult& result) const {
  const double reach = limits.window / 2;
  const bool shown = (left_mask_ == nullptr || !left_mask_->hides(left, reach)) &&
                     (right_mask_ == nullptr || !right_mask_->hides(right, reach));
  if (!shown) ++result.rejected.no_track;
  return shown;
}

bool MatchPoints::nearEpipolarLine(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                                   const Eigen::Vector3d& left_ray, const Eigen::Vector2d& right, Rays& rays,
                                   StereoResult& result) const {
  if (rig_.left.port || rig_.right.port) {
    const RayPair both = raysOf(rig_, left, right);
    rays.left = both.left;
    rays.right = both.right;
  } else {
    rays.left = left_ray;
    rays.right = rig_.right.ray(right);
  }
  rays.offset = epipolar_.offset(rays.left, rays.right);
  if (std::abs(rays.offset.distance) > limits.max_epipolar_distance) {
    ++result.rejected.epipolar;
    return false;
  }
  return true;
}

void MatchPoints::add(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                      const Eigen::Vector2d& right, const Rays& rays, const Eigen::Matrix2d& covariance,
                      StereoResult& result) {
  Eigen::Vector3d point;
  if (!triangulation_.point(rays.left, rays.right, point) || !(point.z() >= limits.min_range) ||
      !(point.z() <= limits.max_range)) {
    ++result.rejected.range;
    return;
  }
  result.points.push_back(
      pointOf(triangulation_, left, right, rays.left, rays.right, point, covariance, limits.sigma_scale));
  noise_.add(rays.offset, covariance);
}

}  // namespace fathom::stereo

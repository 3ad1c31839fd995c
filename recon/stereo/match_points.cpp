#include "recon/stereo/match_points.hpp"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/image_view.hpp"
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

namespace {

// [u.u -u.v; u.v -v.v] (s, t) = (u.b, v.b); false for parallel rays.
struct Normal {
  double uu, uv, vv, determinant;
  Normal(const Eigen::Vector3d& u, const Eigen::Vector3d& v)
      : uu(u.squaredNorm()), uv(u.dot(v)), vv(v.squaredNorm()), determinant(uv * uv - uu * vv) {}
  [[nodiscard]] bool solvable() const {
    constexpr double kParallel = 1e-12;  // squared sine of the angle between the rays
    return -determinant > kParallel * uu * vv;
  }
  [[nodiscard]] Eigen::Vector2d solve(double a, double b) const {
    return Eigen::Vector2d(-vv * a + uv * b, -uv * a + uu * b) / determinant;
  }
};

Eigen::Matrix2d throughLens(const Camera& camera, const Eigen::Vector3d& ray, const Eigen::Matrix2d& pixel) {
  const Eigen::Matrix2d inverse = camera.pixelJacobian(ray.head<2>()).inverse();
  return inverse * pixel * inverse.transpose();
}

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

MidpointTriangulation::MidpointTriangulation(const StereoRig& rig)
    : left_(rig.left),
      right_(rig.right),
      rotation_(rig.T_right_left.matrix3().transpose()),
      baseline_(-(rotation_ * rig.T_right_left.translation())) {}

bool MidpointTriangulation::point(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray,
                                  Eigen::Vector3d& point) const {
  const Eigen::Vector3d &u = left_ray, v = rotation_ * right_ray;
  const Normal normal(u, v);
  if (!normal.solvable()) return false;
  const Eigen::Vector2d st = normal.solve(u.dot(baseline_), v.dot(baseline_));
  if (!(st.x() > 0 && st.y() > 0)) return false;
  point = 0.5 * (st.x() * u + baseline_ + st.y() * v);
  return true;
}

Eigen::Matrix3d MidpointTriangulation::covariance(const Eigen::Vector3d& left_ray,
                                                  const Eigen::Vector3d& right_ray,
                                                  const Eigen::Matrix2d& left_pixel,
                                                  const Eigen::Matrix2d& right_pixel) const {
  const Eigen::Vector3d &u = left_ray, v = rotation_ * right_ray, &b = baseline_;
  const Normal normal(u, v);
  if (!normal.solvable()) return Eigen::Matrix3d::Zero();
  const Eigen::Vector2d st = normal.solve(u.dot(b), v.dot(b));
  const double s = st.x(), t = st.y();
  Eigen::Matrix<double, 3, 2> by_left, by_right;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d du = Eigen::Vector3d::Unit(i);
    const Eigen::Vector2d left = normal.solve(du.dot(b) - 2 * s * du.dot(u) + t * du.dot(v), -s * du.dot(v));
    by_left.col(i) = 0.5 * (s * du + left.x() * u + left.y() * v);
    const Eigen::Vector3d dv = rotation_.col(i);
    const Eigen::Vector2d right = normal.solve(t * dv.dot(u), dv.dot(b) - s * dv.dot(u) + 2 * t * dv.dot(v));
    by_right.col(i) = 0.5 * (t * dv + right.x() * u + right.y() * v);
  }
  return by_left * throughLens(left_, left_ray, left_pixel) * by_left.transpose() +
         by_right * throughLens(right_, right_ray, right_pixel) * by_right.transpose();
}

StereoPoint pointOf(const MidpointTriangulation& triangulation, const Eigen::Vector2d& left,
                    const Eigen::Vector2d& right, const Eigen::Vector3d& left_ray,
                    const Eigen::Vector3d& right_ray, const Eigen::Vector3d& point,
                    const Eigen::Matrix2d& match, double scale) {
  const Eigen::Matrix2d floor = 0.5 * kPixelFloor * kPixelFloor * Eigen::Matrix2d::Identity();
  const Eigen::Matrix3d c =
      scale * scale * triangulation.covariance(left_ray, right_ray, floor, floor + match);
  const auto entry = [&](int i, int j) { return static_cast<float>(c(i, j)); };
  return {left.cast<float>(),
          right.cast<float>(),
          point.cast<float>(),
          std::sqrt(entry(2, 2)),
          {entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)}};
}

MatchNoise::MatchNoise(std::size_t max_matches) {
  matches_.reserve(max_matches);
  ratios_.reserve(max_matches);
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
    ratios_.push_back(std::abs(a.distance - b.distance) / hypotenuse(a.sigma, b.sigma));
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
  const int reach = limits.window / 2;
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

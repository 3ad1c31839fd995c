#include "recon/stereo/midpoint_triangulation.hpp"

#include <Eigen/Dense>
#include <cmath>

namespace fathom::stereo {
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

}  // namespace fathom::stereo

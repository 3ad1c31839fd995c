#pragma once

#include <Eigen/Core>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// Least standard deviation of a match [px]: errors of interpolation and lens model, which the windows'
// difference does not show.
constexpr double kPixelFloor = 0.02;

// Points from matched pixels, with their first-order covariance.
//
// With rays u = (x, y, 1) of the left camera and v = R (x', y', 1) of the right one, both in the left frame,
// and the baseline b, the point is X = (s u + b + t v) / 2 where s, t solve the normal equations
// of s u = b + t v:
//   [u.u  -u.v] [s]   [u.b]
//   [u.v  -v.v] [t] = [v.b].
// For each of x, y, x', y' the derivatives of s and t follow from the differentiated equations, and those of
// X from the product rule: J, 3x4. The covariance is J S J^T (Hartley & Zisserman 2004, 5.2.1), where S holds
// the two pixels' covariances, taken from distorted pixels to x, y by the inverse Jacobian of the lens. For
// parallel cameras and a disparity error sigma_d it gives sigma_z = z^2 sigma_d / (f b).
class MidpointTriangulation {
 public:
  explicit MidpointTriangulation(const StereoRig& rig);

  // The point in the left camera frame [m], as fathom::triangulateMidpoint; rays in their own cameras'
  // frames, z = 1. False when they are parallel or meet behind a camera.
  [[nodiscard]] bool point(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray,
                           Eigen::Vector3d& point) const;

  // Covariance of that point [m^2] for covariances of the distorted pixels [px^2].
  [[nodiscard]] Eigen::Matrix3d covariance(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray,
                                           const Eigen::Matrix2d& left_pixel,
                                           const Eigen::Matrix2d& right_pixel) const;

 private:
  Camera left_, right_;
  Eigen::Matrix3d rotation_;  // R, right to left
  Eigen::Vector3d baseline_;  // b, the right camera's centre [m]
};

// A stereo point with the covariance that follows from `match`, the match's [px^2], which is all ascribed to
// the right pixel. kPixelFloor is added for both pixels, so that the point's covariance has full rank.
// `scale`: factor of the standard deviations.
[[nodiscard]] StereoPoint pointOf(const MidpointTriangulation& triangulation, const Eigen::Vector2d& left,
                                  const Eigen::Vector2d& right, const Eigen::Vector3d& left_ray,
                                  const Eigen::Vector3d& right_ray, const Eigen::Vector3d& point,
                                  const Eigen::Matrix2d& match, double scale);

}  // namespace fathom::stereo

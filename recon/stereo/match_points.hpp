#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// A plane in a camera's frame: normal . p = distance.
struct ViewPlane {
  Eigen::Vector3d normal;
  double distance;  // [m]
};

// Candidate positions in one camera of a pixel of the other: the images of points along the pixel's ray about
// its intersection with the seafloor plane, through the lens distortion of both cameras.
class EpipolarSearch {
 public:
  // `T_to_from` maps points of the rays' frame into that of `to`. `step`: spacing of candidates; `radius`:
  // their reach on each side of the seed [px]. Depths along the ray stay within min_range and max_range [m].
  EpipolarSearch(const Camera& to, const SE3& T_to_from, double step, double radius, double min_range,
                 double max_range);

  // Changes the camera and its pose; the limits stay.
  void look(const Camera& to, const SE3& T_to_from);

  // Candidates in order of falling depth for a ray (x, y, 1); those outside the other image are left out. The
  // result is reused by the next call.
  const std::vector<Eigen::Vector2d>& candidates(const Eigen::Vector3d& ray, const ViewPlane& plane);

  // The same for the seed alone; false when the other camera does not see it with `margin` [px].
  [[nodiscard]] bool seed(const Eigen::Vector3d& ray, const ViewPlane& plane, double margin,
                          Eigen::Vector2d& pixel) const;

 private:
  [[nodiscard]] double seedInverseDepth(const Eigen::Vector3d& ray, const ViewPlane& plane) const;
  [[nodiscard]] bool project(const Eigen::Vector3d& rotated_ray, double inverse_depth,
                             Eigen::Vector2d& pixel) const;

  Camera to_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;  // [m]
  double step_, radius_;         // [px]
  double nearest_, farthest_;    // inverse depth [1/m]
  std::vector<Eigen::Vector2d> candidates_;
};

// Distance of an undistorted right ray (x, y, 1) from the epipolar line of an undistorted left ray, in
// right pixels.
class EpipolarDistance {
 public:
  explicit EpipolarDistance(const StereoRig& rig);
  // Unsigned [px].
  [[nodiscard]] double operator()(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray) const;
  struct Offset {
    double distance;         // signed, along the normal [px]
    Eigen::Vector2d normal;  // of the line, unit
  };
  [[nodiscard]] Offset offset(const Eigen::Vector3d& left_ray, const Eigen::Vector3d& right_ray) const;

 private:
  Eigen::Matrix3d essential_;  // [t]x R
  double focal_;               // [px]
};

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

// Ratio of the errors of a frame's matches to their predicted standard deviations, measured across the
// epipolar line, where the truth is known.
//
// The predicted covariances hold for independent noise of pixels. Interpolated Bayer mosaics, smoothing and
// two views of the ground correlate it, and the errors grow (up to twice in simulated surveys), along the
// epipolar line, which gives the depth, as across it. For matches i and j that are neighbours in the image,
// with signed epipolar distances e and predicted standard deviations s,
//   (e_i - e_j) / sqrt(s_i^2 + s_j^2)
// has this ratio as its standard deviation; a calibration's error varies slowly over the image and cancels.
// The median of the magnitudes keeps outliers out.
class MatchNoise {
 public:
  // Reserves the memory for this many matches.
  explicit MatchNoise(std::size_t max_matches);

  void clear() { matches_.clear(); }
  // Adds a match: its offset from the epipolar line and its covariance [px^2]. Matches added in succession
  // should be near each other in the image.
  void add(const EpipolarDistance::Offset& offset, const Eigen::Matrix2d& covariance);
  // The ratio, at least kLeast; kUsual with fewer than kMinMatches matches.
  [[nodiscard]] double scale();
  // Inflates all covariances of a result by the ratio, and stores it in result.noise_scale.
  void widen(StereoResult& result);

  static constexpr std::size_t kMinMatches = 30;
  static constexpr double kUsual = 1.5;  // in simulated surveys, 12-bit Bayer left and mono right
  static constexpr double kLeast = 0.3;  // in images without noise the errors are those of kPixelFloor alone

 private:
  struct Match {
    double distance, sigma;
  };
  std::vector<Match> matches_;
  std::vector<double> ratios_;
};

// From matched pixels to the points of a result, with the checks and counts of sparse and dense stereo.
class MatchPoints {
 public:
  // Reserves the memory for this many points.
  MatchPoints(const StereoRig& rig, std::size_t max_points);

  // Changes the rig; image sizes stay.
  void setRig(const StereoRig& rig);

  // Empties `result` for a new frame; false when the images are not 8-bit mono of the rig's size, or the
  // plane is not valid.
  [[nodiscard]] bool begin(const ImageView& left, const ImageView& right, const SeedPlane& plane,
                           StereoResult& result);
  // The same without images.
  void begin(StereoResult& result);

  // False, and counted as `no_track`, where a mask hides part of the window about either pixel.
  [[nodiscard]] bool showsGround(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                                 const Eigen::Vector2d& right, StereoResult& result) const;

  struct Rays {
    Eigen::Vector3d left, right;  // (x, y, 1), each in its own camera's frame
    EpipolarDistance::Offset offset;
  };
  // False, and counted, when a match is too far from its epipolar line. `left_ray`: of the left pixel, by the
  // central camera; behind a flat port `rays` are those for the depth that both pixels give.
  [[nodiscard]] bool nearEpipolarLine(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                                      const Eigen::Vector3d& left_ray, const Eigen::Vector2d& right,
                                      Rays& rays, StereoResult& result) const;
  // Triangulates and appends; a point out of range is counted instead. `covariance`: of the match [px^2].
  void add(const SparseStereoConfig& limits, const Eigen::Vector2d& left, const Eigen::Vector2d& right,
           const Rays& rays, const Eigen::Matrix2d& covariance, StereoResult& result);
  // Inflates the points' covariances by the frame's noise; call it after the last add().
  void widen(StereoResult& result) { noise_.widen(result); }

 private:
  StereoRig rig_;
  EpipolarDistance epipolar_;
  MidpointTriangulation triangulation_;
  MatchNoise noise_;
  const ImageMask *left_mask_ = nullptr, *right_mask_ = nullptr;  // of this frame
};

}  // namespace fathom::stereo

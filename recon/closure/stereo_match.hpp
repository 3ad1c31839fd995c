#pragma once

#include <Eigen/Core>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

// Limits of a point's depth [m].
struct DepthRange {
  double nearest = 0.5, farthest = 12.0;
};

struct StereoMatchConfig {
  int search_window = 11;              // edge of the correlation window [px], odd
  int refine_window = 15;              // edge of the window of the sub-pixel position [px], odd
  double min_correlation = 0.75;       // zero-mean normalised
  double max_second_peak = 0.95;       // best correlation elsewhere on the line over the best
  double max_epipolar_distance = 1.0;  // [px]
};

struct StereoMatch {
  Eigen::Vector2d right;       // distorted pixel
  Eigen::Matrix2d covariance;  // of it [px^2]
  Eigen::Vector3d point;       // left camera frame [m]
};

// Finds the right pixel of a left one: correlation of windows along the epipolar line through both lenses in
// steps of one pixel, then PatchAligner on both coordinates.
class StereoMatcher {
 public:
  StereoMatcher(const StereoRig& rig, const StereoMatchConfig& config) : rig_(rig), config_(config) {}

  // `left`, `right`: 8-bit mono, the rig's size.
  [[nodiscard]] bool match(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                           const DepthRange& depths, StereoMatch& found) const;

  // Covariance of the point of a match [m^2], first order (Hartley & Zisserman 2004, 5.2.1): the place of the
  // feature in the left image, of standard deviation `sigma_place` [px], moves both pixels alike; the match
  // moves the right one.
  [[nodiscard]] Eigen::Matrix3d pointCovariance(const Eigen::Vector2d& left_pixel, const StereoMatch& match,
                                                double sigma_place) const;

 private:
  [[nodiscard]] bool search(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                            const DepthRange& depths, Eigen::Vector2d& right_pixel) const;
  [[nodiscard]] bool refine(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                            StereoMatch& found) const;

  StereoRig rig_;
  StereoMatchConfig config_;
};

}  // namespace fathom::closure

#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "recon/stereo/epipolar_search.hpp"
#include "recon/stereo/match_noise.hpp"
#include "recon/stereo/midpoint_triangulation.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// From matched pixels to the points of a result, with the checks and counts that sparse and dense stereo
// share.
class MatchPoints {
 public:
  // Reserves the memory for this many points.
  MatchPoints(const StereoRig& rig, std::size_t max_points);

  // Of the same size.
  void setRig(const StereoRig& rig);

  // Empties `result` for a new frame; false when the images are not 8-bit mono of the rig's size, or the
  // plane is none.
  [[nodiscard]] bool begin(const ImageView& left, const ImageView& right, const SeedPlane& plane,
                           StereoResult& result);
  // The same where there are no images.
  void begin(StereoResult& result);

  // False, and counted as `no_track`, where the window about either pixel shows the vehicle.
  [[nodiscard]] bool showsGround(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                                 const Eigen::Vector2d& right, StereoResult& result) const;

  struct Rays {
    Eigen::Vector3d left, right;  // (x, y, 1), each in its own camera's frame
    EpipolarDistance::Offset offset;
  };
  // False, and counted, when a match lies too far off its epipolar line. `left_ray`: of the left pixel, by
  // the central camera; behind a flat port the rays are those of the depth that both pixels give.
  [[nodiscard]] bool nearEpipolarLine(const SparseStereoConfig& limits, const Eigen::Vector2d& left,
                                      const Eigen::Vector3d& left_ray, const Eigen::Vector2d& right,
                                      Rays& rays, StereoResult& result) const;
  // Triangulates and appends; a point out of range is counted instead. `covariance`: of the match [px^2].
  void add(const SparseStereoConfig& limits, const Eigen::Vector2d& left, const Eigen::Vector2d& right,
           const Rays& rays, const Eigen::Matrix2d& covariance, StereoResult& result);
  // Widens the points' covariances by the frame's own noise, once all are in.
  void widen(StereoResult& result) { noise_.widen(result); }

 private:
  StereoRig rig_;
  EpipolarDistance epipolar_;
  MidpointTriangulation triangulation_;
  MatchNoise noise_;
  const ImageMask *left_mask_ = nullptr, *right_mask_ = nullptr;  // of this frame
};

}  // namespace fathom::stereo

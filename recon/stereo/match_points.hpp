#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/stereo/epipolar_search.hpp"
#include "recon/stereo/midpoint_triangulation.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

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

  void clear();
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

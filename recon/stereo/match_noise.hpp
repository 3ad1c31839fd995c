#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/stereo/epipolar_search.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// How much larger the errors of a frame's matches are than their covariances say, measured across the
// epipolar line, where the truth is known.
//
// The covariances hold for noise that is independent from pixel to pixel. Interpolated Bayer mosaics,
// smoothing and windows that look at the ground from two sides correlate it, and the errors grow (to twice in
// simulated surveys); the same noise acts along the epipolar line, where the depth is read. For matches i and
// j that are neighbours in the image, with signed epipolar distances e and their predicted standard
// deviations s,
//   (e_i - e_j) / sqrt(s_i^2 + s_j^2)
// has the standard deviation wanted; a calibration's error, which varies slowly over the image, drops out.
// From the median of the magnitudes, so that wrong matches do not count.
class MatchNoise {
 public:
  // Reserves the memory for this many matches.
  explicit MatchNoise(std::size_t max_matches);

  void clear();
  // Where a match lies beside its epipolar line, and its covariance [px^2]. Matches added one after the other
  // should be near each other.
  void add(const EpipolarDistance::Offset& offset, const Eigen::Matrix2d& covariance);
  // Of the standard deviations, at least kLeast; kUsual from fewer than kMinMatches matches.
  [[nodiscard]] double scale();
  // Widens all covariances of a result by the scale, and notes it there.
  void widen(StereoResult& result);

  static constexpr std::size_t kMinMatches = 30;
  static constexpr double kUsual = 1.5;  // in simulated surveys, 12-bit Bayer left and mono right
  static constexpr double kLeast =
      0.3;  // no images are so free of noise that the floor alone misleads by more

 private:
  struct Match {
    double distance, sigma;
  };
  std::vector<Match> matches_;
  std::vector<double> ratios_;
};

}  // namespace fathom::stereo

#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// A rectangle of a disparity image; its plane d = mean + slope . (p - centre) is fitted, its slope not kept.
struct DisparityCell {
  int x = 0, y = 0, width = 0, height = 0;           // [px]
  int valid = 0;                                     // pixels with a disparity
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // mean of the valid pixels [px]
  double mean = 0;                                   // disparity at the centre [px]
  double rms = 0;                                    // of the valid pixels' residuals from the plane [px]
};

// Simplifies a disparity image to about a wanted number of cells: small where the surface bends or breaks,
// large where a plane fits. Greedy, after the insertion of points of Garland & Heckbert 1995 ("Fast polygonal
// approximation of terrains and height fields"): the cell with the largest cost, the sum of its squared
// residuals (capped) and of its weighted area, is cut in four next. Rectangle sums use integral images, so
// the run time is linear in the pixels and n log n in the cells.
class DisparityCells {
 public:
  static constexpr int kMinEdge = 4;  // no cut gives a shorter edge; cells at the border may be narrower [px]

  // `disparity`: width * height values [px], NaN where there is none. Returns about `wanted` cells at
  // most, each with a valid pixel, in reading order; none for a wrong size. The vector is overwritten by
  // the next call.
  const std::vector<DisparityCell>& simplify(std::span<const float> disparity, int width, int height,
                                             int wanted);

 private:
  static constexpr std::size_t kMoments = 10;  // 1, x, y, xx, xy, yy, d, xd, yd, dd
  using Moments = std::array<double, kMoments>;
  struct Candidate {
    double cost;  // [px^2]
    DisparityCell cell;
  };

  void integrate(std::span<const float> disparity);
  [[nodiscard]] Moments sum(int x, int y, int width, int height) const;
  [[nodiscard]] DisparityCell fit(int x, int y, int width, int height) const;
  void offer(int x, int y, int width, int height);
  void cutWorst();

  int width_ = 0, height_ = 0;
  double offset_ = 0;  // taken off the disparities, so that squares keep their precision [px]
  std::vector<Moments> integral_;
  std::vector<Candidate> heap_;
  std::vector<DisparityCell> cells_;
};

struct DenseStereoConfig {
  double scale = 0.5;  // of the images' sides that are matched, 0.1 to 1
  int block = 5;       // edge of the matched window [px of the scaled image], odd, 1 to 21
};

// Dense stereo for topside: semi-global matching (Hirschmueller 2008, OpenCV's StereoSGBM) of rectified,
// scaled images. DisparityCells reduces the disparities to the wanted number of points, denser where the
// surface bends; Lucas-Kanade at the full resolution confirms and refines each point. Points are spread
// evenly where corners are clustered. The result has the type, frame and pixels of SparseStereo's.
class DenseStereo {
 public:
  // `limits.max_features` is the wanted number of points; search radius, ranges, edges, slope and patch size
  // are those of SparseStereo. Throws std::invalid_argument for a configuration out of range or for cameras
  // that are not side by side.
  DenseStereo(const StereoRig& rig, const SparseStereoConfig& limits, const DenseStereoConfig& config);
  ~DenseStereo();

  // As SparseStereo::process. `corners` of the result counts cells. Cells with too few disparities or not
  // confirmed by Lucas-Kanade are `no_track`; smallest cells across a step in depth are `outlier`.
  const StereoResult& process(const ImageView& left, const ImageView& right, const SeedPlane& plane);

  // Stages: "rectify", "matching", "cells", "outliers", "triangles".
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::stereo

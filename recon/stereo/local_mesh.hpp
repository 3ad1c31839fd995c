#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/depth_consistency.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// The last steps from matched points to a local mesh: outliers in depth are dropped, the other points are
// triangulated in the image plane, and triangles that span separate surfaces are removed.
class LocalMesh {
 public:
  // Reserves the memory for this many points.
  explicit LocalMesh(std::size_t max_points);

  // Drops the outliers that DepthConsistency finds, and counts them in result.rejected.
  void dropOutliers(const SparseStereoConfig& limits, StereoResult& result);

  // Fills result.triangles: Delaunay triangles of the left pixels (rounded) with edges up to max_edge and
  // slopes up to max_slope, without those over parts that `mask`, of the left image, hides.
  void triangulate(const SparseStereoConfig& limits, StereoResult& result, const ImageMask* mask = nullptr);

 private:
  const std::vector<Delaunay::Triangle>& triangulatePixels(const StereoResult& result);

  Delaunay delaunay_;
  DepthConsistency consistency_;
  std::vector<Delaunay::Point> pixels_;
  std::vector<DepthConsistency::Verdict> verdicts_;
};

}  // namespace fathom::stereo

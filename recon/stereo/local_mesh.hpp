#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/depth_consistency.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// The last steps from matched points to a local mesh: what contradicts its surroundings is dropped, the rest
// is triangulated in the image plane, and triangles that no camera could have seen as one surface are cut.
class LocalMesh {
 public:
  // Reserves the memory for this many points.
  explicit LocalMesh(std::size_t max_points);

  // Drops points that DepthConsistency finds out, and counts them in result.rejected.
  void dropOutliers(const SparseStereoConfig& limits, StereoResult& result);

  // Fills result.triangles: Delaunay triangles of the left pixels (rounded) whose edges are no longer than
  // max_edge, seen no flatter than max_slope. Those that span what `mask`, the left image's, hides are left
  // out: nobody saw ground there.
  void triangulate(const SparseStereoConfig& limits, StereoResult& result, const ImageMask* mask = nullptr);

 private:
  const std::vector<Delaunay::Triangle>& triangulatePixels(const StereoResult& result);

  Delaunay delaunay_;
  DepthConsistency consistency_;
  std::vector<Delaunay::Point> pixels_;
  std::vector<DepthConsistency::Verdict> verdicts_;
};

}  // namespace fathom::stereo

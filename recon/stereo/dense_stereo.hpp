#pragma once

#include <functional>
#include <memory>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

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

#pragma once

#include <functional>
#include <memory>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

struct DenseStereoConfig {
  double scale = 0.5;  // of the images' sides that are matched, 0.1 to 1
  int block = 5;       // edge of the matched window [px of the scaled image], odd, 1 to 21
};

// The topside's other way from a pair to a mesh: semi-global matching (Hirschmueller 2008, as OpenCV's
// StereoSGBM) of rectified, scaled images, simplified to the wanted number of points (DisparityCells), small
// cells where the surface bends, and each point confirmed and sharpened by Lucas-Kanade at the full
// resolution. Spreads points evenly over ground whose corners stand in clusters. The result is of the same
// type and in the same frame and pixels as SparseStereo's.
class DenseStereo {
 public:
  // `limits.max_features` is the wanted number of points; search radius, ranges, edges, slope and patch size
  // mean what they do in SparseStereo. Throws std::invalid_argument for a configuration out of range or a rig
  // whose cameras are not side by side.
  DenseStereo(const StereoRig& rig, const SparseStereoConfig& limits, const DenseStereoConfig& config);
  ~DenseStereo();

  // As SparseStereo::process. `corners` of the result counts cells; cells with too few disparities, or
  // that Lucas-Kanade does not confirm, are `no_track`, cells across a break that could be cut no smaller
  // `outlier`.
  const StereoResult& process(const ImageView& left, const ImageView& right, const SeedPlane& plane);

  // Stages: "rectify", "matching", "cells", "outliers", "triangles".
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::stereo

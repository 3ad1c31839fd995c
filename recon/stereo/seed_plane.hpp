#pragma once

#include <optional>
#include <span>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// Where to look when nobody knows the altitude: a level plane in the middle of the disparities between the
// configured ranges, and a search radius that reaches both ends (or 256 px, the most that SparseStereo
// takes).
struct WideSearch {
  SeedPlane plane;
  double search_radius = 0;  // [px]
};
[[nodiscard]] WideSearch wideSearch(const StereoRig& rig, double min_range, double max_range);

// The plane through stereo points in the left camera frame: inverse depth is linear in the ray, 1/z = n .
// (x/z, y/z, 1) / d, fitted by iteratively reweighted least squares with Cauchy's weights, scale from the
// median absolute residual. Nothing for fewer than 12 points, or for points that no plane in front of the
// camera fits.
[[nodiscard]] std::optional<SeedPlane> fitSeedPlane(std::span<const StereoPoint> points);

// The seafloor's plane from a pair of images alone.
class PlaneScout {
 public:
  // Of `config` the ranges and the checks are used.
  PlaneScout(const StereoRig& rig, SparseStereoConfig config);

  // 8-bit mono images. Nothing where they show too little, or do not belong to one another.
  [[nodiscard]] std::optional<SeedPlane> find(const ImageView& left, const ImageView& right);

 private:
  WideSearch wide_;
  SparseStereo stereo_;
};

}  // namespace fathom::stereo

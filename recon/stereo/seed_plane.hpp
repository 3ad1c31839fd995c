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

}  // namespace fathom::stereo

#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// The search without an altitude: a level plane in the middle of the disparities between the configured
// ranges, and a search radius that reaches both ends (at most 256 px, SparseStereo's limit).
struct WideSearch {
  SeedPlane plane;
  double search_radius = 0;  // [px]
};
[[nodiscard]] WideSearch wideSearch(const StereoRig& rig, double min_range, double max_range);

// The plane through stereo points in the left camera frame: inverse depth is linear in the ray, 1/z = n .
// (x/z, y/z, 1) / d, fitted by iteratively reweighted least squares with Cauchy's weights, scale from the
// median absolute residual. Nothing for fewer than 12 points, or where no plane in front of the camera
// fits them.
[[nodiscard]] std::optional<SeedPlane> fitSeedPlane(std::span<const StereoPoint> points);

// That plane where it is nearer or farther than the seed's by more than half, as of a DVL on a false bottom;
// nothing elsewhere. No call of the heap: `scratch` has at least as many values as there are points.
[[nodiscard]] std::optional<SeedPlane> groundElsewhere(std::span<const StereoPoint> points,
                                                       const SeedPlane& seed, std::span<double> scratch);

// Matches a pair again whose light was corrected for the range of `plane`, where that is not the ground's: by
// a wrong range the light is wrong too, and may leave no contrast. `match(by_range)` corrects the light for
// `plane`, or without a range, and renews `result`; it is called where too few points tell where the ground
// is, and where they show it elsewhere, with `plane` moved there. `scratch` grows to the number of points.
template <typename Match>
void matchWhereGroundIs(const StereoResult& result, SeedPlane& plane, std::vector<double>& scratch,
                        const Match& match) {
  constexpr std::size_t kTellGround = 50;
  if (result.points.size() < kTellGround) match(false);
  scratch.resize(std::max(scratch.size(), result.points.size()));
  if (const auto elsewhere = groundElsewhere(result.points, plane, scratch)) {
    plane = *elsewhere;
    match(true);
  }
}

// The seafloor's plane from a pair of images alone.
class PlaneScout {
 public:
  // Uses the ranges and checks of `config`.
  PlaneScout(const StereoRig& rig, SparseStereoConfig config);

  // 8-bit mono images. Nothing for too few matches or images that do not overlap.
  [[nodiscard]] std::optional<SeedPlane> find(const ImageView& left, const ImageView& right);

 private:
  WideSearch wide_;
  SparseStereo stereo_;
};

}  // namespace fathom::stereo

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "recon/calibration/rig_bundle.hpp"

namespace fathom::calibration {

// All sightings of one place of the scene.
struct RigTrack {
  struct Sighting {
    std::uint32_t pair = 0;
    bool right = false;
    Eigen::Vector2d pixel;
  };
  std::vector<Sighting> sightings;  // at most one in an image
};

// Tracks of a rig that moved over a static scene.
struct RigTracks {
  ImageSize left, right;
  std::vector<std::string> names;  // of the pairs, in order of time
  std::vector<RigTrack> tracks;    // with outliers
};

struct SelfCalibrationConfig {
  RigBundleConfig bundle;
  int least_pairs = 3;                 // that are joined
  double most_focal_sigma = 0.01;      // of a focal length's logarithm: above, it is not determined
  double most_turn_sigma = 0.0035;     // of a turn of the rig about an axis [rad]
  double gross_px = 3.0, gross = 4.0;  // an outlier is farther off than both, the latter in sigmas
};

// The rig from its own images: both cameras' focal lengths, principal points and distortion (Brown, k3 zero)
// and the rig's relative pose, except for its length, `baseline` [m], which images do not determine.
//
// Focal length and first radial coefficient come from a grid: of each, the essential matrix that most matches
// between left and right agree with (Nister 2004, RANSAC over all pairs at once, because the rig is rigid)
// starts a model, pair after pair by perspective pose; bundle adjustment follows, and the best is refined
// while outliers are rejected. A view is a pair that was joined; its residuals are of the sightings
// that took part. Throws InputError (`source`: what to name) when too few pairs are joined, or the solution's
// standard deviations show that focal length or turn are not determined: over a level seafloor viewed from
// straight above, a longer lens is equivalent to a shorter distance.
[[nodiscard]] RigCalibration selfCalibrate(const RigTracks& seen, double baseline,
                                           const SelfCalibrationConfig& config, const std::string& source);

}  // namespace fathom::calibration

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "recon/calibration/rig_bundle.hpp"

namespace fathom::calibration {

// One place of the scene, wherever it was seen.
struct Track {
  struct Sighting {
    std::uint32_t pair = 0;
    bool right = false;
    Eigen::Vector2d pixel;
  };
  std::vector<Sighting> sightings;  // at most one in an image
};

// What a rig saw while it moved over a scene that stood still.
struct RigTracks {
  ImageSize left, right;
  std::vector<std::string> names;  // of the pairs, in the order of the way
  std::vector<Track> tracks;       // some of them wrong
};

struct SelfCalibrationConfig {
  BundleConfig bundle;
  int least_pairs = 3;                 // that the way joins
  double most_focal_sigma = 0.01;      // of a focal length's logarithm: more, and the images do not tell it
  double most_turn_sigma = 0.0035;     // of a turn of the rig about an axis [rad]
  double gross_px = 3.0, gross = 4.0;  // a sighting farther off than both, the latter in sigmas, is wrong
};

// The rig from its own images: both cameras' focal lengths, principal points and distortion (Brown, k3 zero)
// and the rig's relative pose, but for its length, `baseline` [m], which images cannot tell.
//
// Focal length and first radial coefficient come from a grid: of each, the essential matrix that most matches
// between left and right agree with (Nister 2004, RANSAC over all pairs at once, because the rig is rigid)
// starts a model, pair after pair by perspective pose; bundle adjustment follows, and the best is refined
// while wrong sightings are taken out. A view is a pair that was joined; its residuals are of the sightings
// that took part. Throws InputError (`source`: what to name) when too few pairs are joined, or the solution's
// standard deviations say that focal length or turn stay open: of a level seafloor seen from straight above
// only, a longer lens is the same as less distance.
[[nodiscard]] RigCalibration selfCalibrate(const RigTracks& seen, double baseline,
                                           const SelfCalibrationConfig& config, const std::string& source);

}  // namespace fathom::calibration

#pragma once

#include <filesystem>

namespace fathom::sim {

// Density, detectability and noise of simulated stereo features. The defaults are measured on the features
// that closure extracts from rendered reefs.
struct SimulatedFeatureConfig {
  double landmarks_per_view = 850;  // on level ground, at any altitude
  double smallest_size = 0.008;     // of a feature, over the image's width; the largest is four times it
  // The detection probability of a landmark is uniform between these.
  double least_detection = 0.3, most_detection = 0.95;
  double half_contrast = 4;  // ratio of contrast to pixel noise that halves the detections

  std::filesystem::path match_errors{};  // MatchErrors' file; empty: the shipped one
  // Part of the place error's variance that is one smooth field over the image.
  double place_shared_variance = 0.06;
  double descriptor_noise = 0.35;  // median in a view, over the descriptor's standard deviation

  // Errors of calibration and lighting, drawn once for each dive: see the table in sim/README.md.
  double shared_place = 2e-4, shared_place_slope = 7e-4;
  double shared_disparity_px = 0.01, shared_disparity_slope_px = 0.04;

  // Perceptual aliasing: this fraction of the landmarks repeats with the ripples' wavelength across the
  // crests and with alike_along_m along them.
  double alike_share = 0;
  double alike_along_m = 0.4;
};

}  // namespace fathom::sim

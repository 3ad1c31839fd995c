#pragma once

#include <Eigen/Core>

namespace fathom::sim {

// Density, detectability and noise of simulated stereo features. The defaults are measured on the features
// that closure extracts from rendered reefs.
struct SimulatedFeatureConfig {
  double landmarks_per_view = 850;  // on level ground, at any altitude
  double smallest_size = 0.008;     // of a feature, over the image's width; the largest is four times it
  // The detection probability of a landmark is uniform between these.
  double least_detection = 0.3, most_detection = 0.95;
  double half_contrast = 4;  // ratio of contrast to pixel noise that halves the detections

  // Standard deviations along x and y of a landmark's place from view to view.
  double place_sigma = 0.00035;        // over the image's width
  double place_sigma_per_size = 0.02;  // added, over the feature's size
  // Part of the variance that is a smooth field over the image, since neighbours share pixels and shading.
  double place_shared_variance = 0.25;
  double displaced_probability = 0.06;  // of a displaced detection: five times the place error
  double match_sigma_px = 0.05;         // of the right pixel against the left one
  double gross_probability = 0.0015;    // of a wrong match on the epipolar line
  double gross_px = 20;                 // largest error of such a match
  double descriptor_noise = 0.35;       // median in a view, over the descriptor's standard deviation

  // Errors of calibration and lighting, drawn once for each dive: closure::SharedErrors.
  double shared_place = 4e-4, shared_place_slope = 1e-3;
  double shared_disparity_px = 0.03, shared_disparity_slope_px = 0.08;

  // Perceptual aliasing: this fraction of the landmarks repeats with the ripples' wavelength across the
  // crests and with alike_along_m along them.
  double alike_share = 0;
  double alike_along_m = 0.4;
};

}  // namespace fathom::sim

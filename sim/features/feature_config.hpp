#pragma once

#include <Eigen/Core>

namespace fathom::sim {

// Matched stereo features instead of pictures: how many landmarks the ground carries, and how well they are
// seen. The defaults are what closure's features on rendered reefs show.
struct FeatureConfig {
  double landmarks_per_view = 850;  // on level ground, at any altitude
  double smallest_size = 0.008;  // of what is described, by the image's width; the largest is four times it
  // Every landmark has its own probability of being detected, even between these.
  double least_detection = 0.3, most_detection = 0.95;
  double half_contrast = 4;  // contrast over noise of a pixel at which half as many are detected

  // Standard deviations along x and y of a landmark's place from view to view.
  double place_sigma = 0.00035;        // by the image's width
  double place_sigma_per_size = 0.02;  // more of it, by the size
  // Neighbours share pixels and shading: this part of the variance is one smooth field over the image.
  double place_shared_variance = 0.25;
  double slip_probability = 0.06;     // of finding a landmark beside its place, five times as far off
  double match_sigma_px = 0.05;       // of the right pixel against the left one
  double gross_probability = 0.0015;  // of a match with something else on the epipolar line
  double gross_px = 20;               // largest error of such a match
  double descriptor_noise = 0.35;     // median in a view, by the descriptor's own spread

  // What calibration and lamps leave, drawn once a dive: closure::SharedErrors.
  double shared_place = 4e-4, shared_place_slope = 1e-3;
  double shared_disparity_px = 0.03, shared_disparity_slope_px = 0.08;

  // Ground that deceives: this part of the landmarks looks the same at the same place of every ripple, with
  // the ripples' wavelength across the crests and this period along them.
  double alike_share = 0;
  double alike_along_m = 0.4;
};

}  // namespace fathom::sim

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

void visitFeatures(KeyVisitor& keys, FeatureConfig& f) {
  keys.enter("features", "of missions without pictures (render --features)");
  keys.number("landmarks_per_view", f.landmarks_per_view, "1", 50, 5000, "on level ground, at any altitude");
  keys.number("smallest_size", f.smallest_size, "1", 0.002, 0.1,
              "of what is described, by the image's width; the largest is four times it");
  keys.number("least_detection", f.least_detection, "1", 0, 1,
              "every landmark has its own probability of being detected, even between this");
  keys.number("most_detection", f.most_detection, "1", 0, 1, "and this");
  keys.number("half_contrast", f.half_contrast, "1", 0, 100,
              "contrast over noise of a pixel at which half as many are detected");
  keys.number("place_sigma", f.place_sigma, "1", 1e-5, 0.01,
              "of a landmark's place from view to view, by the image's width");
  keys.number("place_sigma_per_size", f.place_sigma_per_size, "1", 0, 1, "more of it, by the size");
  keys.number("place_shared_variance", f.place_shared_variance, "1", 0, 1,
              "part of that variance which neighbours in an image share");
  keys.number("slip_probability", f.slip_probability, "1", 0, 1,
              "of finding a landmark beside its place, five times as far off");
  keys.number("match_sigma_px", f.match_sigma_px, "px", 0.002, 0.4,
              "of the right pixel against the left one");
  keys.number("gross_probability", f.gross_probability, "1", 0, 1, "of a wrong match on the epipolar line");
  keys.number("gross_px", f.gross_px, "px", 0, 500, "largest error of such a match");
  keys.number("descriptor_noise", f.descriptor_noise, "1", 0, 1.9,
              "median in a view, by the descriptor's own spread");
  keys.number("shared_place", f.shared_place, "1", 0, 0.01,
              "standard deviation of what moves all features alike, drawn once a dive; tangent");
  keys.number("shared_place_slope", f.shared_place_slope, "1", 0, 0.1,
              "likewise, radial; tangent by tangent");
  keys.number("shared_disparity_px", f.shared_disparity_px, "px", 0, 5, "likewise, of the disparity");
  keys.number("shared_disparity_slope_px", f.shared_disparity_slope_px, "px", 0, 5, "likewise, by tangent");
  keys.number("alike_share", f.alike_share, "1", 0, 1,
              "of the landmarks, those that look the same at the same place of every ripple");
  keys.number("alike_along_m", f.alike_along_m, "m", 0.05, 10,
              "their period along the crests; across it is ripples.wavelength_m");
  keys.leave();
}

}  // namespace fathom::sim

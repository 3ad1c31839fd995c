#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// A place that both cameras of a rig saw, as matching left it, without the pixels about it.
struct StereoFeature {
  Eigen::Vector2f left, right;  // distorted pixels
  float size = 0;               // diameter of what is described [px of the left image]
  // Standard deviations along x and y, each: of the place in the left image, from what another view would
  // find it to be, which moves both pixels alike; and of the match, which moves the right one [px].
  float place_sigma = 0, match_sigma = 0;
  Rgb colour{};  // of the surface, sRGB
  // What the surroundings look like, in place of pixels to describe: simulatedDescriptor() expands it.
  std::uint64_t simulated_appearance = 0;
  float simulated_noise = 0;  // of the descriptor in this view, by the descriptor's own spread
};

// What a stereo pair saw, where a mission keeps features instead of images. Strongest first.
struct StereoFeatureFrame {
  int width = 0, height = 0;              // of the left image [px]
  std::uint64_t simulated_view_seed = 0;  // of the descriptors' noise in this view
  std::vector<StereoFeature> features;
};

}  // namespace fathom

#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// A descriptor of 8 bits a bin: square roots of a SIFT histogram of sum 1 (Arandjelovic 2012).
using RootSift = std::array<std::uint8_t, 128>;

// A place matched in both images of a rig, without the pixels about it.
struct StereoFeature {
  Eigen::Vector2f left, right;  // distorted pixels
  float size = 0;               // diameter of what is described [px of the left image]
  // Standard deviations along x and y, each: of the place in the left image, from what another view would
  // find it to be, which moves both pixels alike; and of the match, which moves the right one [px].
  float place_sigma = 0, match_sigma = 0;
  Rgb colour{};  // of the surface, sRGB
  RootSift descriptor{};
};

// Features of a stereo pair, where a mission keeps these instead of images. Strongest first.
struct StereoFeatureFrame {
  int width = 0, height = 0;  // of the left image [px]
  std::vector<StereoFeature> features;
};

}  // namespace fathom

#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fathom::closure {

// How the surroundings of a feature are described. The numbers are stored: never change them.
enum class DescriptorKind : std::uint8_t {
  kRootSift = 1,  // 128 values of 8 bits: square roots of a SIFT histogram of sum 1 (Arandjelovic 2012)
  kOrb = 2,       // 256 bits
  kAkaze = 3,     // 486 bits (MLDB)
  kBrisk = 4,     // 512 bits
};

[[nodiscard]] std::size_t descriptorBytes(DescriptorKind kind);

// A place that is seen by both cameras of one stereo frame.
struct Feature {
  Eigen::Vector2f left, right;      // distorted pixels
  Eigen::Vector3f point;            // left camera frame [m]
  std::array<float, 6> covariance;  // of the point: xx, xy, xz, yy, yz, zz [m^2]; its place in the left image
                                    // counts as uncertain by what another view would find it to be
  float size;                       // diameter of what is described [px of the left image]

  [[nodiscard]] Eigen::Matrix3d covarianceMatrix() const;
};

// What one stereo frame is remembered by.
struct FrameFeatures {
  DescriptorKind kind = DescriptorKind::kRootSift;
  std::vector<Feature> features;
  std::vector<std::uint8_t> descriptors;  // descriptorBytes(kind) for each feature

  [[nodiscard]] std::size_t size() const { return features.size(); }
  void reserve(std::size_t most) {
    features.reserve(most);
    descriptors.reserve(most * descriptorBytes(kind));
  }
  [[nodiscard]] const std::uint8_t* descriptor(std::size_t i) const {
    return descriptors.data() + i * descriptorBytes(kind);
  }
};

}  // namespace fathom::closure

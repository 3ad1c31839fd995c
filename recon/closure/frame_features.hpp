#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "recon/geometry/stereo_feature_frame.hpp"

namespace fathom::closure {

// Of a root-SIFT descriptor.
constexpr std::size_t kDescriptorBytes = std::tuple_size_v<RootSift>;

// Cells of the left image: features are spread over them, and coverage counts those with inliers.
constexpr int kCellsAcross = 8, kCellsDown = 6;

// Of a covariance: xx, xy, xz, yy, yz, zz.
[[nodiscard]] inline std::array<float, 6> upperTriangle(const Eigen::Matrix3f& c) {
  return {c(0, 0), c(0, 1), c(0, 2), c(1, 1), c(1, 2), c(2, 2)};
}

// A place that both cameras of one stereo frame see.
struct Feature {
  Eigen::Vector2f left, right;      // distorted pixels
  Eigen::Vector3f point;            // left camera frame [m]
  std::array<float, 6> covariance;  // of the point: xx, xy, xz, yy, yz, zz [m^2]; includes the uncertainty of
                                    // its place in the left image from view to view
  float size;                       // diameter of what is described [px of the left image]

  [[nodiscard]] Eigen::Matrix3d covarianceMatrix() const;
};

// Features of one stereo frame, as kept for later registration.
struct FrameFeatures {
  std::vector<Feature> features;
  std::vector<std::uint8_t> descriptors;  // kDescriptorBytes for each feature

  [[nodiscard]] std::size_t size() const { return features.size(); }
  void reserve(std::size_t most) {
    features.reserve(most);
    descriptors.reserve(most * kDescriptorBytes);
  }
  void clear() {
    features.clear();
    descriptors.clear();
  }
  [[nodiscard]] const std::uint8_t* descriptor(std::size_t i) const {
    return descriptors.data() + i * kDescriptorBytes;
  }
};

// One frame's features as a block of fixed size, for a preallocated file of equal slots:
//   u32 magic "FCL1", u8 kind, u8 zero, u16 count, count records, then zeros up to the slot's size.
// A record: left x y, right x y, point x y z, covariance of 6, size (14 f32), then the descriptor. Little
// endian. 600 features: 110,408 bytes.
constexpr std::size_t kMaxSlotFeatures = 65535;
constexpr std::uint8_t kSlotKind = 1;  // root-SIFT, in slots and saved state

[[nodiscard]] std::size_t slotBytes(std::size_t max_features);

// False, leaving `slot` as it was, when the features do not fit in.
[[nodiscard]] bool writeSlot(const FrameFeatures& frame, std::span<std::uint8_t> slot);

// False, leaving `frame` empty, for bytes that are no slot: wrong magic, unknown kind, a count beyond the
// block, numbers that are not finite, points not in front of the camera, covariances not positive.
[[nodiscard]] bool readSlot(std::span<const std::uint8_t> slot, FrameFeatures& frame);

// Feature `a` of one frame looks like feature `b` of another.
struct Match {
  int a = 0, b = 0;
};

struct MatchConfig {
  double max_ratio = 0.85;      // best distance over the best one elsewhere in the image
  double near_tie_ratio = 0.9;  // features within this ratio of the best distance count as alike
  int max_alike = 3;            // of them for one feature
};

struct Matches {
  std::vector<Match> best;   // mutual best matches that pass the ratio test, by a
  std::vector<Match> alike;  // every feature's best and near ties, by a: what repeats appears several times
};

// Squared Euclidean distances of descriptors, a.size() x b.size(): whole numbers, exact in floats, so that
// every processor gives the same.
void descriptorDistances(const FrameFeatures& a, const FrameFeatures& b, Eigen::MatrixXf& distances);

// Squared distance of each feature's descriptor to the nearest one elsewhere in the same frame.
[[nodiscard]] std::vector<float> nearestElsewhere(const FrameFeatures& frame);

// `allowed`: false for pairs that contradict the prior of the relative pose; null: all are allowed. The
// second best of the ratio test is the best elsewhere in the image: one place often gives two features.
void matchDescriptors(const FrameFeatures& a, const FrameFeatures& b, const Eigen::MatrixXf& distances,
                      const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>* allowed,
                      const MatchConfig& config, Matches& matches);

}  // namespace fathom::closure

#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/closure/frame_features.hpp"

namespace fathom::closure {

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

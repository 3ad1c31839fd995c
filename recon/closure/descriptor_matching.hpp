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
  double max_ratio = 0.85;      // of the best distance to the best one elsewhere
  double near_tie_ratio = 0.9;  // looser: what looks nearly as good as the best also counts as alike
  int max_alike = 3;            // of them for one feature
};

struct Matches {
  std::vector<Match> best;   // mutual best that pass the ratio test, by a
  std::vector<Match> alike;  // every feature's best and near ties, by a: what repeats appears several times
};

// Squared distances of descriptors, a.size() x b.size(): Euclidean for root-SIFT (whole numbers, exact in
// floats, so that every processor gives the same), Hamming squared for bits. Both frames must be of one kind.
void descriptorDistances(const FrameFeatures& a, const FrameFeatures& b, Eigen::MatrixXf& distances);

// Squared distance of each feature's descriptor to the nearest one elsewhere in the same frame.
[[nodiscard]] std::vector<float> nearestElsewhere(const FrameFeatures& frame);

// `allowed`: false for pairs that what is known of the relative pose forbids; null: none is forbidden. The
// second best of the ratio test must lie elsewhere in the image: one place often gives two features.
void matchDescriptors(const FrameFeatures& a, const FrameFeatures& b, const Eigen::MatrixXf& distances,
                      const Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>* allowed,
                      const MatchConfig& config, Matches& matches);

}  // namespace fathom::closure

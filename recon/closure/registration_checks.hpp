#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/closure/descriptor_matching.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/closure/point_alignment.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

using PairMask = Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>;  // a's features x b's

// Points of both frames for each match.
[[nodiscard]] std::vector<PointPair> pointPairs(const StereoRig& rig, const SharedErrors& shared,
                                                const FrameFeatures& a, const FrameFeatures& b,
                                                const std::vector<Match>& matches);

// Squared Mahalanobis distance of T_a_b from a prior, of the right perturbation (rho, phi) from the prior to
// it, under the sum of both covariances.
[[nodiscard]] double distanceFromPrior(const SE3& T_a_b, const Matrix6d& covariance, const SE3& prior,
                                       const Matrix6d& prior_covariance);

// Pairs of features whose points can be one under the prior: within 99.9 % of chi-square, counting the
// points' own covariances and that of the prior. Returns how many.
std::size_t maskByPrior(const FrameFeatures& a, const FrameFeatures& b, const SE3& prior,
                        const Matrix6d& prior_covariance, PairMask& mask);

// Features that look like nothing else in their own frame: the nearest descriptor elsewhere is farther than
// the typical (median) distance of the inliers by 1 / ratio.
struct Distinct {
  std::vector<bool> a, b;
};
[[nodiscard]] Distinct distinctFeatures(const FrameFeatures& a, const FrameFeatures& b,
                                        const Eigen::MatrixXf& distances, const std::vector<Match>& inliers,
                                        double ratio);

// How the inliers of a pose fill what both frames see.
struct OverlapUse {
  int features = 0;  // that lie in the overlap, in the frame with fewer of them
  double share = 0;  // inliers by that number
  double coverage =
      0;  // of cells of the left image of a that hold features of the overlap: those with inliers
  // The same of distinct features alone: what repeats fills an overlap wherever it is laid.
  int distinct_inliers = 0;
  double distinct_coverage = 0;
};
[[nodiscard]] OverlapUse overlapUse(const StereoRig& rig, const FrameFeatures& a, const FrameFeatures& b,
                                    const std::vector<Match>& inliers, const Distinct& distinct,
                                    const SE3& T_a_b);

// -log10 of the expected number of poses that `inliers` of `matches` random matches would fit as well,
// "number of false alarms" of an a-contrario model (Moisan & Stival 2004):
//   NFA = (M - 3) C(M, k) C(k, 3) p^(k - 3),
// p: the share of all allowed pairs of features that fit the pose by chance, counted.
[[nodiscard]] double significance(const FrameFeatures& a, const FrameFeatures& b, const PairMask* allowed,
                                  std::size_t matches, std::size_t inliers, const SE3& T_a_b, double gate);

// Inliers among look-alike matches of the best other pose, by those of `pose`: near 1 where the ground
// repeats. Features count once however many look-alikes they have.
[[nodiscard]] double rivalShare(const std::vector<PointPair>& alike, const std::vector<Match>& matches,
                                const SE3& pose, double gate, const SampleConfig& sample);

}  // namespace fathom::closure

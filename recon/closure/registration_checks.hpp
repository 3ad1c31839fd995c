#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/closure/descriptor_matching.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/closure/point_alignment.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

using PairMask = Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic>;  // a's features x b's

// Points of both frames, for each match.
[[nodiscard]] std::vector<PointPair> pointPairs(const StereoRig& rig, const SharedErrors& shared,
                                                const FrameFeatures& a, const FrameFeatures& b,
                                                const std::vector<Match>& matches);

// Squared Mahalanobis distance of T_a_b from a prior: of the right perturbation (rho, phi) between them,
// under the sum of both covariances.
[[nodiscard]] double distanceFromPrior(const SE3& T_a_b, const Matrix6d& covariance, const SE3& prior,
                                       const Matrix6d& prior_covariance);

// Gates pairs of features by the prior: 99.9 % of chi-square of the distance of their points, under the
// points' covariances and that of the prior.
void maskByPrior(const FrameFeatures& a, const FrameFeatures& b, const SE3& prior,
                 const Matrix6d& prior_covariance, PairMask& mask);

// Features without a look-alike in their own frame: the nearest descriptor elsewhere is farther than the
// median distance of the inliers by 1 / ratio.
struct Distinct {
  std::vector<bool> a, b;
};
[[nodiscard]] Distinct distinctFeatures(const FrameFeatures& a, const FrameFeatures& b,
                                        const Eigen::MatrixXf& distances, const std::vector<Match>& inliers,
                                        double ratio);

// Use of the overlap of two frames by the inliers of a pose.
struct OverlapUse {
  int features = 0;     // in the overlap, of the frame with fewer
  double share = 0;     // inliers over that number
  double coverage = 0;  // of the cells of a's left image with features of the overlap, the share with inliers
  // The same of distinct features alone: repeated features fill the overlap of a wrong pose too.
  int distinct_inliers = 0;
  double distinct_coverage = 0;
};
[[nodiscard]] OverlapUse overlapUse(const StereoRig& rig, const FrameFeatures& a, const FrameFeatures& b,
                                    const std::vector<Match>& inliers, const Distinct& distinct,
                                    const SE3& T_a_b);

// -log10 of the expected number of poses with so many inliers among random matches, the "number of false
// alarms" of an a-contrario model (Moisan & Stival 2004), for k `inliers` of M `matches`:
//   NFA = (M - 3) C(M, k) C(k, 3) p^(k - 3),
// p: the counted share of all allowed pairs of features that fit the pose by chance.
[[nodiscard]] double significance(const FrameFeatures& a, const FrameFeatures& b, const PairMask* allowed,
                                  std::size_t matches, std::size_t inliers, const SE3& T_a_b, double gate);

// Inliers of the best other pose among look-alike matches, over those of `pose`: near 1 where the ground
// repeats. Each feature counts once.
[[nodiscard]] double rivalShare(const std::vector<PointPair>& alike, const std::vector<Match>& matches,
                                const SE3& pose, double gate, const SampleConfig& sample);

}  // namespace fathom::closure

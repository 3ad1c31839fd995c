#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "recon/closure/frame_features.hpp"
#include "recon/closure/point_alignment.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/geometry/uncertain_pose.hpp"

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

using RelativePrior = UncertainPose;  // of the relative pose, before registration

enum class Refusal : std::uint8_t {
  kNone,
  kNoFeatures,     // a frame has too few
  kFewMatches,     // too few mutual matches
  kNoPose,         // no pose with several inliers
  kFewInliers,     // too few of the matches fit the pose
  kLowShare,       // too small a share of the features in the overlap
  kNarrow,         // inliers fill a small part of the overlap: one object that looks like another
  kChance,         // as many random matches could fit
  kContradiction,  // contradicts the prior, or the prior is not finite
  kAmbiguous,      // another pose fits nearly as many look-alikes, and too few features are distinct
  kVague,          // too large a covariance
};
constexpr std::size_t kRefusals = 11;
[[nodiscard]] std::string_view nameOf(Refusal refusal);

struct RegistrationConfig {
  MatchConfig match;
  SampleConfig sample;
  SharedErrors shared;
  int min_inliers = 15;
  double min_inlier_share = 0.12;     // of the features in the overlap (of the frame with fewer)
  double min_coverage = 0.6;          // share of the overlap's cells with features that hold inliers
  double min_significance = 20;       // -log10 of the expected number of such poses among random matches
  double max_prior_distance = 22.46;  // squared Mahalanobis: 99.9 % of chi-square with 6 degrees of freedom
  double max_rival_share = 0.3;       // inliers of another pose among look-alikes over those of this one
  // Neighbouring features share pixels and shading, so that their errors are correlated: covariances are
  // inflated by this factor, measured on rendered surveys under moving lamps.
  double covariance_scale = 1.7;
  double max_sigma_position = 0.05;  // [m]
  double max_sigma_angle = 0.025;    // [rad]
};

struct Registration {
  Refusal refusal = Refusal::kNoFeatures;
  SE3 T_a_b;                                   // maps points of frame b's left camera into frame a's
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation (rho, phi) [m, rad]
  std::vector<Match> inliers;                  // matches of the pose
  double noise = 1;          // standard deviation of the residuals over that of the points' covariances
  int matches = 0;           // mutual best
  int overlap_features = 0;  // in the overlap of the frames
  int distinct_inliers = 0;  // inliers without a look-alike in their own frame
  double share = 0, coverage = 0, distinct_coverage = 0, significance = 0, prior_distance = 0,
         rival_share = 0;  // values of the checks

  [[nodiscard]] bool accepted() const { return refusal == Refusal::kNone; }
};

// Finds the relative pose of two stereo frames from their features alone, or the reason for the refusal:
//   descriptors ─► mutual best, ratio ─► three-point samples ─► Cauchy ─► maximum likelihood ─► checks
// after Mahon et al. 2008. For closures (wide or no prior) and for visual odometry (a narrow one). A prior
// also restricts the matches. Same input, same result.
class Registrar {
 public:
  // Throws std::invalid_argument for a configuration out of range.
  Registrar(const StereoRig& rig, const RegistrationConfig& config);
  ~Registrar();

  // The result is reused by the next call.
  const Registration& process(const FrameFeatures& a, const FrameFeatures& b,
                              const std::optional<RelativePrior>& prior);

  // Called with the stage's name at the end of each stage of process(): "match", "sample", "align", "check".
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::closure

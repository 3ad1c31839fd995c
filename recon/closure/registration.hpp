#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "recon/closure/descriptor_matching.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/closure/point_alignment.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::closure {

using RelativePrior = UncertainPose;  // what is known of the relative pose before

enum class Refusal : std::uint8_t {
  kNone,
  kNoFeatures,     // a frame has too few, or the two are of different kinds
  kFewMatches,     // too few mutual matches
  kNoPose,         // no pose that several matches share
  kFewInliers,     // too few of the matches fit the pose
  kLowShare,       // too few of the features that both frames should see
  kNarrow,         // inliers fill a small part of the overlap only: one thing that looks like another
  kChance,         // as many random matches could fit
  kContradiction,  // disagrees with what was known, or that is not finite
  kAmbiguous,      // another pose explains nearly as many look-alikes, and too little is distinct
  kVague,          // the covariance is too large to be of use
};
constexpr std::size_t kRefusals = 11;
[[nodiscard]] std::string_view nameOf(Refusal refusal);

struct RegistrationConfig {
  MatchConfig match;
  SampleConfig sample;
  SharedErrors shared;
  int min_inliers = 15;
  double min_inlier_share = 0.12;     // of the features that lie in the overlap (of the frame with fewer)
  double min_coverage = 0.6;          // of the overlap's cells that hold features, those that hold inliers
  double min_significance = 20;       // -log10 of the expected number of such poses among random matches
  double max_prior_distance = 22.46;  // squared Mahalanobis: 99.9 % of chi-square with 6 degrees of freedom
  double max_rival_share = 0.3;       // inliers of another pose among look-alikes, by those of this one
  // Neighbouring features share pixels and shading, so that they tell less than their number: variances are
  // widened by this, as rendered surveys under moving lamps ask for.
  double covariance_scale = 1.7;
  double max_sigma_position = 0.05;  // [m]
  double max_sigma_angle = 0.025;    // [rad]
};

struct Registration {
  Refusal refusal = Refusal::kNoFeatures;
  SE3 T_a_b;                                   // maps points of frame b's left camera into frame a's
  Matrix6d covariance = Matrix6d::Identity();  // of its right perturbation (rho, phi) [m, rad]
  std::vector<Match> inliers;                  // features that the pose was made from
  double noise = 1;                            // of the residuals by what the points claim
  int matches = 0;                             // mutual best
  int overlap_features = 0;                    // that both frames should see
  int distinct_inliers = 0;                    // that look like nothing else in their own frame
  double share = 0, coverage = 0, distinct_coverage = 0, significance = 0, prior_distance = 0,
         rival_share = 0;  // as tested

  [[nodiscard]] bool accepted() const { return refusal == Refusal::kNone; }
};

// The relative pose of two stereo frames from their features alone, or the reason why there is none:
//   descriptors ─► mutual best, ratio ─► three-point samples ─► Cauchy ─► maximum likelihood ─► checks
// after Mahon et al. 2008. For closures (wide or no prior) and for visual odometry (a narrow one, which then
// also restricts the matches). Same input, same result.
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

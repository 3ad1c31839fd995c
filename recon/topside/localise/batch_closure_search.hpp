#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "recon/closure/candidates.hpp"
#include "recon/closure/place_index.hpp"
#include "recon/closure/registration.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/solver/batch/graph_covariance.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// One pair of frames to register, and what came of it.
struct Attempt {
  std::uint32_t a = 0, b = 0;  // frames, a before b
  std::optional<closure::RelativePrior> prior;
  closure::Refusal refusal = closure::Refusal::kNoFeatures;
  slam::NavigationLink link;  // where it was accepted
  [[nodiscard]] bool accepted() const { return refusal == closure::Refusal::kNone; }
};

using FramePairs = std::vector<std::pair<std::uint32_t, std::uint32_t>>;
[[nodiscard]] std::vector<Attempt> attemptsOf(const FramePairs& pairs);  // without priors
[[nodiscard]] slam::NavigationLink linkOf(const closure::Claim& claim);
// Of a relative pose, of standard deviations [m], [rad].
[[nodiscard]] Matrix6d covarianceOf(double position, double angle);

// Registers all of them, by as many threads as are allowed; those of one frame `b` after each other load it
// once. `stage` names them in the progress.
void registerAll(const StereoRig& rig, const Frames& frames, const closure::RegistrationConfig& config,
                 std::vector<Attempt>& attempts, const char* stage);

// Revisited track length [m]: as poses and covariances predict it, and the part that no closure has verified.
// Ground counts as revisited if the vehicle went away in between.
struct Crossings {
  double expected = 0, unverified = 0;
};

// Looks for loop closures in rounds: each round's solution says where the next one looks.
//
// Any pair of frames may be tried whose footprints can overlap within three standard deviations of what the
// solution's graph knows of their separation, in both directions (closure::StretchTree); of these the ones by
// which most is expected to be learnt: probability of the overlap times information. Paths through the factor
// are walked once for eight frames and used for all that these are paired with, so the cost of a round is in
// proportion to the pairs near each other. What does not depend on the number of threads: the result.
//
// A closure whose prior was wider than a footprint could be any of several look-alike places: it waits until
// another one of neighbouring frames agrees with it.
class BatchClosureSearch {
 public:
  // `rig` and `frames` must outlive it. `visual_scale`: SensorNoise's. `open`: what is not known of the rig.
  BatchClosureSearch(const StereoRig& rig, const Frames& frames, double visual_scale,
                     const slam::RigPrior& open = {});
  ~BatchClosureSearch();

  // Errors that the features of the whole dive share, in standard deviations of what is not known before:
  // columns of closure::poseBySharedErrors().
  using Shared = slam::GraphCovariance::Errors;
  [[nodiscard]] std::vector<slam::NavigationLink> straightened(std::vector<slam::NavigationLink> links,
                                                               const Shared& by) const;
  [[nodiscard]] double disparityError(const Shared& by, const Eigen::Vector2d& tangent) const;  // [px]
  // The next round looks from here; `solution` must stay until attempt() has ended, which also frees the
  // memory that this takes. `links`: of it. What it says of the errors that they share, known().shared() has.
  void look(const slam::NavigationSolution& solution, const std::vector<slam::NavigationLink>& links,
            const Shared& straightened_by = Shared::Zero());
  // The same without a next round: what it says of these errors alone.
  [[nodiscard]] Shared estimate(const slam::NavigationSolution& solution,
                                const std::vector<slam::NavigationLink>& links,
                                const Shared& straightened_by);
  // What its graph knows.
  [[nodiscard]] const slam::GraphCovariance& known() const;

  // The most valuable candidates, at most `most` and `a_frame` of a frame, by their newer frame. A pair that
  // was refused before comes again once its prior has moved by several standard deviations.
  [[nodiscard]] std::vector<Attempt> candidates(std::size_t most, std::size_t a_frame);
  // Registers them all. Returns the accepted links, with earlier ones that they confirm.
  std::vector<slam::NavigationLink> attempt(std::vector<Attempt>& attempts);

  // With the closures among `links` that were kept.
  [[nodiscard]] Crossings crossings(const std::vector<slam::NavigationLink>& links);

  [[nodiscard]] const std::array<std::size_t, closure::kRefusals>& refused() const { return refused_; }
  [[nodiscard]] std::size_t unconfirmed() const { return waiting_.size(); }

 private:
  struct View;  // of a solution
  struct Tried {
    SE3 T_a_b;
    Vector6d variance;  // of the prior
    bool accepted = false;
  };
  [[nodiscard]] slam::GraphCovariance graphOf(const slam::NavigationSolution& solution,
                                              const std::vector<slam::NavigationLink>& links,
                                              const Shared& straightened_by) const;
  [[nodiscard]] slam::GraphCovariance::ByShared sharedBy(const slam::NavigationLink& link) const;
  [[nodiscard]] bool worthTrying(const closure::Candidate& candidate) const;
  [[nodiscard]] std::vector<closure::Candidate> proposed(std::size_t a_frame);
  [[nodiscard]] bool confirmed(const Attempt& one, const Attempt& other);

  const StereoRig& rig_;
  const Frames& frames_;
  double visual_scale_;
  slam::RigPrior open_;
  std::unique_ptr<View> view_;
  std::vector<std::uint32_t> older_end_;            // of each frame: the first that is too near to be tried
  std::unordered_map<std::uint64_t, Tried> tried_;  // by both frames
  std::vector<Attempt> waiting_;                    // accepted, to be confirmed
  std::array<std::size_t, closure::kRefusals> refused_{};
};

}  // namespace fathom::topside

#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "realtime/kernel/numbered_pool.hpp"
#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/localisation_config.hpp"
#include "realtime/onboard/localisation/tried_pairs.hpp"
#include "recon/closure/candidates.hpp"

namespace fathom::onboard {

// A loop closure that entered the graph.
struct Closure {
  int a = 0, b = 0;  // keyframes
  SE3 T_a_b;
  Matrix6d covariance;  // of its right perturbation
  int inliers = 0;
  bool confirmed = false;  // by another one, as its prior was wide

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.a, self.b, self.T_a_b, self.covariance, self.inliers, self.confirmed);
  }
};

// Finds loop closures on board: pairs of keyframes by the probability that their footprints overlap and what
// a registration would tell, kept in a bounded queue, the most valuable first, a few registrations a
// keyframe.
//
// A closure whose prior is wider than the footprint could be any of several look-alike places. It waits until
// another one, of a neighbouring pair of keyframes, agrees with it around the cycle; meanwhile such
// neighbours are tried first.
class ClosureSearch {
 public:
  ClosureSearch(const StereoRig& rig, const LocalisationConfig& config, slam::NavigationGraph& graph,
                KeyframeFeatures& features);

  // The next keyframe, `range` above the seafloor along the camera's axis [m].
  void addKeyframe(double range) {
    View view;
    view.range = range;
    (void)views_.add(view);
  }
  // A keyframe is gone: what waits for it is given up.
  void retire(int keyframe);
  // Queues the pairs of a keyframe, new or moved, with all others. The graph has taken it in.
  void propose(int keyframe);
  // The same for one keyframe, if any, that has moved by half of its footprint since.
  void proposeMoved();
  // At most so many registrations.
  void work(int registrations);

  [[nodiscard]] closure::Footprint footprint(int keyframe) const;
  [[nodiscard]] const std::vector<Closure>& closures() const { return closures_; }

  struct Counters {
    std::uint64_t predictions = 0, proposed = 0, stale = 0, registrations = 0, accepted = 0, waited = 0,
                  confirmed = 0, unconfirmed = 0, contradicting = 0;
    std::array<std::uint64_t, closure::kRefusals> refused{};
    std::size_t waiting = 0, unconfirmed_now = 0;
    std::uint64_t dropped = 0;  // candidates, for want of room
  };
  [[nodiscard]] Counters counters() const;
  [[nodiscard]] std::size_t memoryBytes() const;

  // Saved state (state_archive.hpp), bit by bit; into one whose graph has its keyframes already.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);

  struct Near {
    double distance2;
    int keyframe;
  };
  struct Seen {  // a candidate with what the graph knows of it now
    closure::Candidate candidate;
    slam::NavigationGraph::Prediction prediction;
    double sigma = 0;  // horizontal, along the wider axis [m]
  };
  [[nodiscard]] Seen look(int a, int b);
  [[nodiscard]] bool worthIt(const closure::Candidate& candidate) const;
  void registerPair(const Seen& seen);
  void keep(const Closure& closure);
  void confirm(const Closure& closure);
  [[nodiscard]] bool agrees(const Closure& x, const Closure& y);
  void seekNeighbours(const Closure& closure);

  struct View {
    double range = 0;  // to the seafloor [m]
    Eigen::Vector2d proposed_at = Eigen::Vector2d::Zero();

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.range, self.proposed_at);
    }
  };

  Camera camera_;
  LocalisationConfig config_;
  slam::NavigationGraph& graph_;
  KeyframeFeatures& features_;
  closure::Registrar registrar_;
  closure::CandidateQueue queue_;
  closure::CandidateConfig limits_;
  double reach_;                  // of two discs of radius 1
  rt::NumberedPool<View> views_;  // of keyframes
  std::size_t next_moved_ = 0;    // position among them
  std::vector<Near> near_;
  TriedPairs tried_;
  std::vector<Closure> unconfirmed_;  // oldest first
  std::vector<Closure> closures_;
  Counters counters_;
};

}  // namespace fathom::onboard

#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/localisation_config.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/closure/place_index.hpp"

namespace fathom::onboard {

// Pairs of keyframes that were tried, each with their separation then, so that a pair is tried again only
// when that has changed. A hash table of fixed size; when it is full it forgets everything, which only costs
// time.
class TriedPairs {
 public:
  // `capacity`: pairs, rounded up to a power of two.
  explicit TriedPairs(std::size_t capacity) {
    std::size_t size = 16;
    while (size < 2 * capacity) size *= 2;
    table_.assign(size, {});
  }

  // Tried at this separation [m]; another one by more than `within` [m] is another try.
  void insert(int a, int b, const Eigen::Vector2d& separation, double within) {
    if (2 * count_ >= table_.size()) {
      table_.assign(table_.size(), {});
      count_ = 0;
    }
    Tried& tried = table_[find(key(a, b))];
    if (tried.pair == 0) ++count_;
    tried = {key(a, b), separation.cast<float>(), static_cast<float>(within)};
  }
  // Tried as it is for ever.
  void insert(int a, int b) { insert(a, b, {0, 0}, std::numeric_limits<double>::infinity()); }

  [[nodiscard]] bool contains(int a, int b, const Eigen::Vector2d& separation) const {
    const Tried& tried = table_[find(key(a, b))];
    return tried.pair != 0 && (separation.cast<float>() - tried.separation).norm() <= tried.within;
  }
  [[nodiscard]] bool contains(int a, int b) const { return contains(a, b, {0, 0}); }
  [[nodiscard]] std::size_t memoryBytes() const { return table_.size() * sizeof(table_[0]); }

  // For saved state (state_archive.hpp): the same pairs.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t count = self.count_;
    archive(count);
    archive.require(2 * count <= self.table_.size(), "more pairs than there is room for");
    if constexpr (Archive::kLoading) {
      self.table_.assign(self.table_.size(), {});
      self.count_ = 0;
      for (Tried tried; self.count_ < count; ++self.count_) {
        archive(tried.pair, tried.separation, tried.within);
        if (!archive.ok()) return;
        Tried& place = self.table_[self.find(tried.pair)];
        archive.require(tried.pair != 0 && place.pair == 0, "a pair that comes twice");
        place = tried;
      }
    } else {
      for (const Tried& tried : self.table_)
        if (tried.pair != 0) archive(tried.pair, tried.separation, tried.within);
    }
  }

 private:
  struct Tried {
    std::uint64_t pair = 0;  // 0: an empty place
    Eigen::Vector2f separation = Eigen::Vector2f::Zero();
    float within = 0;
  };
  // Never 0.
  static std::uint64_t key(int a, int b) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(a) + 1U) << 32) |
           static_cast<std::uint32_t>(b);
  }
  [[nodiscard]] std::size_t find(std::uint64_t wanted) const {
    constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;  // Fibonacci hashing (Knuth 1973, 6.4)
    const std::size_t mask = table_.size() - 1;
    std::size_t at = static_cast<std::size_t>((wanted * kGolden) >> 20) & mask;
    while (table_[at].pair != 0 && table_[at].pair != wanted) at = (at + 1) & mask;
    return at;
  }
  std::vector<Tried> table_;
  std::size_t count_ = 0;
};

// A loop closure that entered the graph.
struct Closure {
  int a = 0, b = 0;  // keyframes
  SE3 T_a_b;
  Matrix6d covariance;  // of its right perturbation
  int inliers = 0;
  bool confirmed = false;  // by others, as its prior was wide or wrong

  static void exchange(auto& archive, auto& self) {
    archive(self.a, self.b, self.T_a_b, self.covariance, self.inliers, self.confirmed);
  }
};

// Finds loop closures on board: ranks pairs of keyframes by the probability that their footprints overlap and
// by the information of a registration, keeps them in a bounded queue, the most valuable first, and registers
// a few per keyframe. Pairs are sought within three standard deviations of their relative position in the
// graph, in either direction; a pair is tried again when that position has changed.
//
// The graph may be wrong. Where nothing has been closed for a while, the newest keyframe is recognised by its
// features alone (closure::PlaceIndex) and registered without prior.
//
// A closure with a prior wider than the footprint, or without one, may be of one of several look-alike
// places. It waits until others, of neighbouring pairs of keyframes, agree with it around the cycle
// (closure::Agreement); meanwhile such neighbours are tried first.
class OnlineClosureSearch {
 public:
  OnlineClosureSearch(const StereoRig& rig, const LocalisationConfig& config, slam::NavigationGraph& graph,
                      KeyframeFeatures& features);
  OnlineClosureSearch(const OnlineClosureSearch&) = delete;
  OnlineClosureSearch& operator=(const OnlineClosureSearch&) = delete;

  // The next keyframe, `range` above the seafloor along the camera's axis [m]; numbers rise. Its features are
  // there.
  void addKeyframe(int keyframe, double range);
  // A keyframe that is gone for ever.
  void removeKeyframe(int keyframe);
  // Queues the pairs of a keyframe, new or moved, with all others. The graph has taken it in.
  void propose(int keyframe);
  // The same for one keyframe, if any, that has moved by half of its footprint since.
  void proposeMoved();
  // At most so many registrations.
  void work(int registrations);
  // Where the newest keyframe has been before, whatever the graph says: at most place_tries registrations.
  void recognise(int keyframe);

  [[nodiscard]] closure::Footprint footprint(int keyframe) const;
  [[nodiscard]] const std::vector<Closure>& closures() const { return closures_; }

  struct Counters {
    std::uint64_t predictions = 0, proposed = 0, stale = 0, registrations = 0, accepted = 0, waited = 0,
                  confirmed = 0, unconfirmed = 0, contradicting = 0;
    std::uint64_t places_tried = 0, places_accepted = 0, recognised = 0;  // without prior; that then agreed
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

  struct View {
    int keyframe = 0;
    double range = 0;  // to the seafloor [m]
    Eigen::Vector2d proposed_at = Eigen::Vector2d::Zero();

    static void exchange(auto& archive, auto& self) { archive(self.keyframe, self.range, self.proposed_at); }
  };
  struct Near {
    double rank;  // the least first
    int keyframe;
  };
  struct Pair {
    int a = 0, b = 0;
  };
  struct Seen {  // a candidate with what the graph knows of it now
    closure::Candidate candidate;
    slam::NavigationGraph::Prediction prediction;
    Eigen::Vector2d separation = Eigen::Vector2d::Zero();  // of the footprints, horizontal [m]
    Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();      // its covariance [m^2]
    double sigma = 0;                                      // along its wider axis [m]
  };
  // Covariance of the position of a keyframe relative to the newest, sampled over the dive.
  struct Sample {
    std::size_t view = 0;
    Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  };
  static constexpr std::size_t kSamples = 8;

  [[nodiscard]] std::size_t viewOf(int keyframe) const;  // views_.size(): gone
  [[nodiscard]] closure::Footprint footprint(const View& view) const;
  [[nodiscard]] Seen look(int a, int b);
  [[nodiscard]] bool worthIt(const closure::Candidate& candidate) const;
  void sample(int keyframe);
  [[nodiscard]] const Eigen::Matrix2d& spreadAbout(std::size_t view) const;
  void registerPair(const Seen& seen);
  void registerUnknown(int a, int b);
  void accept(const closure::Claim& claim, const Seen& seen, bool fits);
  void keep(slam::LinkKind kind, const closure::Claim& claim, bool confirmed);
  void seekNeighbours(const closure::Claim& claim);

  Camera camera_;
  LocalisationConfig config_;
  slam::NavigationGraph& graph_;
  KeyframeFeatures& features_;
  closure::Registrar registrar_, strict_;  // with a prior and without
  closure::CandidateQueue queue_;
  closure::CandidateConfig limits_;
  double reach_;             // of two discs of radius 1
  std::vector<View> views_;  // by keyframe
  std::size_t next_moved_ = 0;
  std::vector<Near> near_;
  std::vector<Sample> samples_;
  TriedPairs tried_, recognised_;  // with a prior and without
  closure::PlaceIndex places_;
  std::vector<Pair> sought_;  // to be registered without prior, the best last
  int last_closed_ = 0;       // newest keyframe of the last closure
  closure::Agreement agreement_;
  closure::Agreement::Odometry odometry_;
  std::vector<Closure> closures_;
  Counters counters_;
};

}  // namespace fathom::onboard

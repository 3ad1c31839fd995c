#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::closure {

// Footprint of a frame on the seafloor, in plan: a disc about the intersection of the principal ray.
struct Footprint {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // north, east [m]
  double radius = 0;                                 // [m]
};

// `range`: along the principal ray [m]. The disc has the area that the image covers there: radius
// range sqrt(w h / (pi fx fy)).
[[nodiscard]] Footprint footprintOf(const SE3& T_nav_cam, double range, const Camera& camera);
// Range along the principal ray to level ground `altitude` below the camera [m]; off-vertical
// angles beyond 78 degrees count as 78.
[[nodiscard]] double rangeToLevelGround(const SE3& T_nav_cam, double altitude);

// Separation of two equal discs of radius 1 that share the given part of their area, 0 to 1.
[[nodiscard]] double separationOfOverlap(double share);

// Probability that the separation d ~ N(mean, covariance) [m, m^2] is at most `reach` [m]:
//   P = int_{|d| <= reach} N(d; mean, covariance) dd,
// along the principal axes of the covariance: 32 nodes of Gauss-Legendre over the wider one, the error
// function over the narrower, to 0.01 where the disc's border is sharp (Mahon et al. 2008: loop-closure
// hypotheses under the uncertainty of the relative position).
[[nodiscard]] double overlapProbability(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance,
                                        double reach);

// Information of a measurement of the separation with the standard deviation `sigma` [m], in nat:
//   I = 1/2 log det (1 + covariance / sigma^2),
// the mutual information of measurement and state (Eustice et al. 2006; Ila et al. 2010).
[[nodiscard]] double expectedInformation(const Eigen::Matrix2d& covariance, double sigma);

struct CandidateConfig {
  double min_overlap = 0.3;      // share of the smaller footprint
  double sigma_measured = 0.02;  // of a registration, horizontal [m]
  double min_information = 0.7;  // [nat]; 0.7: the separation is as uncertain as the registration
  std::size_t capacity = 1000;   // pairs in the queue
};

struct Candidate {
  std::uint32_t older = 0, newer = 0;  // indices of frames
  double probability = 0;              // of the overlap
  double information = 0;              // [nat]
  [[nodiscard]] double value() const { return probability * information; }

  static void exchange(auto& archive, auto& self) {
    archive(self.older, self.newer, self.probability, self.information);
  }
};

// The candidate of a pair, from the covariance of the separation of its footprints [m^2]. Discs of different
// size overlap as two of their mean radius. `apart`: separationOfOverlap(config.min_overlap), computed once
// by the caller because it takes longer than the rest.
[[nodiscard]] Candidate candidateOf(std::uint32_t older, const Footprint& there, std::uint32_t newer,
                                    const Footprint& here, const Eigen::Matrix2d& covariance,
                                    const CandidateConfig& config, double apart);

// Pairs of frames to register, those of the greatest expected information (probability times information of a
// registration) first. Bounded: when full, the pair of least value is dropped and counted.
class CandidateQueue {
 public:
  explicit CandidateQueue(const CandidateConfig& config);

  void push(const Candidate& candidate);

  // Takes out the pair of greatest value; of equals the newest. False when empty.
  [[nodiscard]] bool pop(Candidate& candidate);
  void clear() { waiting_.clear(); }

  [[nodiscard]] std::size_t size() const { return waiting_.size(); }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }  // pairs dropped when full

  // Saved state (state_archive.hpp); pairs of frames below `frames`.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, std::size_t frames);

 private:
  CandidateConfig config_;
  std::vector<Candidate> waiting_;  // by value, the best last
  std::uint64_t dropped_ = 0;
};

// Consecutive keyframes searched together, represented by the middle one: the uncertainty of the path between
// them is far below that of a useful prior of a registration.
struct Stretch {
  std::uint32_t first = 0, end = 0;  // frames, one past the last
  [[nodiscard]] std::uint32_t middle() const { return first + (end - first) / 2; }
};

// Gives the 2x2 covariance of the horizontal separation of two frames in nav [m^2].
using Separation = std::function<Eigen::Matrix2d(std::uint32_t older, std::uint32_t newer)>;

// Cuts a dive into stretches of at most eight frames and about three metres of track; where the separation of
// two neighbours' middles has a standard deviation over a decimetre (no bottom track, no visual odometry),
// into single frames. `separation` is called for consecutive middles only.
[[nodiscard]] std::vector<Stretch> stretchesOf(std::span<const Footprint> footprints,
                                               const Separation& separation);

// Finds the stretches with footprints that may overlap under the uncertainty of a solution, without testing
// all of them: a binary tree over time (bounding volume hierarchy). Each node has a box about its footprints
// and a bound on the standard deviation between its middle and any of its frames,
//   leg(node) = max over both halves of  sigma(middle, middle of half) + leg(half),
// because standard deviations along a direction at most add up. A node is skipped when its box is farther
// from the stretch than the footprints' reach plus three standard deviations of the separation and its leg.
class StretchTree {
 public:
  static constexpr double kSigmas = 3;

  // Refers to `footprints`, which must outlive it. `min_overlap`: share of a footprint, as CandidateConfig's.
  StretchTree(std::span<const Footprint> footprints, std::vector<Stretch> stretches, double min_overlap,
              const Separation& separation);

  struct Near {
    std::uint32_t stretch = 0;
    Eigen::Matrix2d covariance;  // of the separation of the two middles [m^2]
  };
  // Replaces `found` by the stretches before the given one that it may overlap, in rising order. Calls
  // `separation` for middles of stretches. Several threads may call at once, each with its own `separation`.
  void near(std::uint32_t stretch, const Separation& separation, std::vector<Near>& found) const;

  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }

 private:
  struct Node {
    std::uint32_t first = 0, end = 0;  // stretches
    std::uint32_t middle = 0;          // a frame
    // Box of the footprints' centres [m].
    Eigen::Vector2d low = Eigen::Vector2d::Zero(), high = Eigen::Vector2d::Zero();
    double radius = 0, leg = 0;  // largest footprint; bound above [m]
    int left = -1, right = -1;   // halves; -1: one stretch
  };
  int build(std::uint32_t first, std::uint32_t end, const Separation& separation);

  std::span<const Footprint> footprints_;
  std::vector<Stretch> stretches_;
  double reach_;  // of two discs of radius 1
  std::vector<Node> nodes_;
  std::vector<int> leaf_;  // node of each stretch
};

}  // namespace fathom::closure

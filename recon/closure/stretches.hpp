#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "recon/closure/candidates.hpp"

namespace fathom::closure {

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

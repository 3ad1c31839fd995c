#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "recon/closure/candidates.hpp"

namespace fathom::closure {

// Consecutive frames of which the middle one tells where the others are: what is not known of the way between
// them is far below what a registration needs as prior.
struct Stretch {
  std::uint32_t first = 0, end = 0;  // frames, one past the last
  [[nodiscard]] std::uint32_t middle() const { return first + (end - first) / 2; }
};

// 2x2 covariance of the horizontal separation of two frames in nav [m^2].
using Separation = std::function<Eigen::Matrix2d(std::uint32_t older, std::uint32_t newer)>;

// Largest standard deviation of a separation, along any direction [m].
[[nodiscard]] double widestSigma(const Eigen::Matrix2d& covariance);

// Cuts a dive into stretches of at most eight frames and about three metres; where the way between the
// middles of two neighbours is known to worse than a decimetre (no bottom track, no visual odometry), into
// single frames. `separation` is asked for consecutive middles only.
[[nodiscard]] std::vector<Stretch> stretchesOf(std::span<const Footprint> footprints,
                                               const Separation& separation);

// Finds the stretches whose footprints may overlap under the uncertainty of a solution, without looking at
// all of them: a binary tree over time (bounding volume hierarchy), each node with a box about its
// footprints, and with a bound of what is not known between its middle and any of its frames,
//   leg(node) = max over both halves of  sigma(middle, middle of half) + leg(half),
// as standard deviations along a direction at most add up. A node is passed over when its box is farther from
// the stretch than the footprints reach and three standard deviations of all that lies between.
class StretchTree {
 public:
  static constexpr double kSigmas = 3;

  // Keeps `footprints`, which must outlive it. `min_overlap`: share of a footprint, as CandidateConfig's.
  StretchTree(std::span<const Footprint> footprints, std::vector<Stretch> stretches, double min_overlap,
              const Separation& separation);

  struct Near {
    std::uint32_t stretch = 0;
    Eigen::Matrix2d covariance;  // of the separation of the two middles [m^2]
  };
  // Replaces `found` by the stretches before the given one that it may overlap, in rising order. Asks
  // `separation` for middles of stretches. Several threads may ask at once, each with its own `separation`.
  void near(std::uint32_t stretch, const Separation& separation, std::vector<Near>& found) const;

  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }

 private:
  struct Node {
    std::uint32_t first = 0, end = 0;  // stretches
    std::uint32_t middle = 0;          // a frame
    // Of the footprints' centres [m].
    Eigen::Vector2d low = Eigen::Vector2d::Zero(), high = Eigen::Vector2d::Zero();
    double radius = 0, leg = 0;  // largest; bound above [m]
    int left = -1, right = -1;   // none: one stretch
  };
  int build(std::uint32_t first, std::uint32_t end, const Separation& separation);

  std::span<const Footprint> footprints_;
  std::vector<Stretch> stretches_;
  double reach_;  // of two discs of radius 1
  std::vector<Node> nodes_;
  std::vector<int> leaf_;  // node of each stretch
};

}  // namespace fathom::closure

#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// Sightings of points by a moving stereo rig, and what else is known of its poses.
struct Bundle {
  struct Sighting {
    std::uint32_t view = 0;
    Eigen::Vector2f left = Eigen::Vector2f::Zero(), right = Eigen::Vector2f::Zero();  // distorted pixels
  };
  StereoRig rig;
  PoseGraph graph;         // T_world_left of the views and other poses; edges: all but what the points say
  std::vector<int> nodes;  // of each view, in `graph`
  std::vector<Sighting> sightings;   // by point
  std::vector<std::uint32_t> first;  // of each point in `sightings`, and one past the last
};

struct BundleConfig {
  // Standard deviations of a coordinate to begin with [px]: of a point's place from view to view; of the
  // right pixel about the left one. They are estimated again from the residuals.
  double place = 0.3, match = 0.1;
  double loss = 3;  // scale of Cauchy's loss [standard deviations]
  // Factor on both at the end: neighbouring points share shading, so that their errors are correlated.
  double widened = 1.7;
  int steps = 20;
};

struct BundleResult {
  std::size_t points = 0, sightings = 0;
  double place_before = 0, place_after = 0;  // root mean square of a coordinate, robustly weighed [px]
  double place = 0, match = 0;               // as found
  int steps = 0;
  bool converged = false;
};

// Calls `one` for each number from `first` to `end` - 1, in any order, by one thread or several.
using ForEach =
    std::function<void(std::size_t first, std::size_t end, const std::function<void(std::size_t)>& one)>;

// Most likely poses: reprojection in both cameras and the graph's edges (Triggs et al. 2000). Points are
// solved for one by one and marginalised (their Schur complement), a block of them at a time, so that memory
// is the poses' and the sightings' own. Gauss-Newton with Marquardt's damping; the first pose of each
// connected part is held. The result does not depend on the order of `for_each`; without it, one by one.
BundleResult adjust(Bundle& bundle, const BundleConfig& config, const ForEach& for_each = {});

}  // namespace fathom::slam

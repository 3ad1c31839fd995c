#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/slam/pose_graph.hpp"

namespace fathom::slam {

// What a stereo rig saw of points on its way, and what else is known of its poses.
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
  // right pixel about the left one. They are found again from what is left over.
  double place = 0.3, match = 0.1;
  double loss = 3;  // standard deviations from which Cauchy's loss forgets a sighting
  double widened =
      1.7;  // of both at the end: neighbouring points share shading, and tell less than their number
  int steps = 20;
};

struct BundleResult {
  std::size_t points = 0, sightings = 0;
  double place_before = 0, place_after = 0;  // root mean square of a coordinate, robustly weighed [px]
  double place = 0, match = 0;               // as found
  int steps = 0;
  bool converged = false;
};

// Calls `one` for each number from `first` up to `end`, in any order, by one thread or several.
using ForEach =
    std::function<void(std::size_t first, std::size_t end, const std::function<void(std::size_t)>& one)>;

// Most likely poses: reprojection in both cameras and the graph's edges (Triggs et al. 2000). Points are
// solved for one by one and marginalised (their Schur complement), a block of them at a time, so that memory
// is the poses' and the sightings' own. Gauss-Newton with Marquardt's damping; the first pose of each
// connected part is held. The result does not depend on how `for_each` does it; without, one by one.
BundleResult adjust(Bundle& bundle, const BundleConfig& config, const ForEach& for_each = {});

}  // namespace fathom::slam

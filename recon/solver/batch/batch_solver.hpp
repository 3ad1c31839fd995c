#pragma once

#include <functional>
#include <vector>

#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// Initial poses from the measurements alone (Carlone, Tron, Daniilidis & Dellaert 2015, chordal relaxation):
// rotations by linear least squares over 3 x 3 matrices, each projected to the nearest rotation, then
// translations by linear least squares. The first pose of each connected part keeps its place.
[[nodiscard]] std::vector<SE3> chordalPoses(const PoseGraph& graph);

struct BatchOptions {
  int max_iterations = 100;
  double min_decrease = 1e-9;  // of chi2, relative: less ends it
  bool chordal = true;         // looks for a better start than the graph's own poses
};

struct BatchResult {
  double chi2_given = 0;  // at the graph's own poses
  double chi2_start = 0;  // where the iterations began: these, or the chordal ones if they are better
  double chi2 = 0;
  bool chordal = false;  // they were
  int iterations = 0;
  bool converged = false;
  double factor_entries = 0;
  std::size_t memory_bytes = 0;  // of the solver's arena, or CHOLMOD's peak
};

// Maximum likelihood poses of a graph, by the incremental solver without quotas; where that does not converge
// or the graph is not in one piece, by Gauss-Newton with Marquardt's damping where chi2 would rise. The first
// pose of each connected part is held. `progress`, if given, receives chi2 after each iteration. Throws
// std::invalid_argument for an edge to a pose that is not there, from a pose to itself, or with an
// information that is not symmetric and positive semidefinite.
BatchResult optimize(PoseGraph& graph, const BatchOptions& options,
                     const std::function<void(int iteration, double chi2)>& progress = {});

}  // namespace fathom::slam

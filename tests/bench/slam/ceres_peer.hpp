#pragma once

#include <string>

#include "recon/slam/pose_graph.hpp"

namespace fathom::bench {

struct CeresOutcome {
  double seconds = 0;  // of ceres::Solve alone, thread time
  double chi2 = 0;
  int iterations = 0;
  std::string options;
  double usual_seconds = 0;  // with Ceres' default trust region instead
};

// The same graph by Ceres from the graph's poses, which become the solution: sparse normal Cholesky by
// SuiteSparse, analytic derivatives in the tangent space, one thread; the quickest of its trust region
// methods among those that reach the least chi2.
[[nodiscard]] CeresOutcome solveByCeres(slam::PoseGraph& graph);

}  // namespace fathom::bench

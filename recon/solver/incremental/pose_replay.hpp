#pragma once

#include <vector>

#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// Gives a finished graph to an incremental solver pose by pose, as it would have come: step k adds pose k and
// every measurement between it and earlier poses. A pose starts where the measurement from its latest
// neighbour puts it; the graph's own poses are used only for the first, and for one without neighbours.
class PoseReplay {
 public:
  explicit PoseReplay(const PoseGraph& graph);  // which must live longer

  [[nodiscard]] bool done() const { return next_ == static_cast<int>(graph_.poses.size()); }
  // Throws std::invalid_argument when the solver refuses a pose or measurement.
  StepReport step(IncrementalSolver& solver);

 private:
  const PoseGraph& graph_;
  std::vector<int> order_;  // measurements by their later end
  std::vector<int> first_;  // of each pose in `order_`
  int next_ = 0;
};

}  // namespace fathom::slam

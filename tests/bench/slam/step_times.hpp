#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/pose_graph.hpp"

namespace fathom::bench {

// The thread's own time: other programs on the machine count little.
[[nodiscard]] double threadMilliseconds();

struct Quantiles {
  double mean = 0, p50 = 0, p99 = 0, p999 = 0, max = 0;
};
[[nodiscard]] Quantiles quantilesOf(std::vector<double> values);

// One graph given pose by pose.
struct StepTimes {
  Quantiles thread_ms;  // the thread's own clock: other programs on the machine count little
  Quantiles wall_ms;
  double seconds = 0;
  std::uint64_t heap_calls = 0;
  std::int64_t resident_before = 0, resident_after = 0;  // of the process, around the steps [bytes]
  slam::StepReport sum, last;                            // work of all steps; the last step
  std::int64_t most_blocks = 0, most_store = 0;          // of a factor, at any step
  int steps_waiting = 0;                                 // in which poses waited for a factor
  double chi2 = 0;                                       // at the end
};
[[nodiscard]] StepTimes timeSteps(const slam::PoseGraph& graph, slam::IncrementalSolver& solver);

void print(const std::string& name, const StepTimes& times, const slam::IncrementalSolver& solver);

}  // namespace fathom::bench

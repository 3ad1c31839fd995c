// Report on the incremental solver: pose graphs given pose by pose, each step timed on the thread's own
// clock, so that other programs on the machine count little. Usage: report_slam [graph.g2o ...]; without a
// name, the three graphs that the tests use.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "recon/slam/batch_solver.hpp"
#include "recon/slam/g2o_file.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/pose_replay.hpp"
#include "tests/support/heap_counter.hpp"

namespace {

using namespace fathom;
using namespace fathom::slam;

double threadMilliseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

void report(const std::string& path) {
  PoseGraph graph = readG2o(path);
  IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size());
  config.max_factor_blocks = 80000;
  IncrementalSolver solver(config);
  PoseReplay replay(graph);
  std::vector<double> times;
  times.reserve(graph.poses.size());
  std::uint64_t heap_calls = 0;
  StepReport sum, last;
  while (!replay.done()) {
    const test::ThreadCost before = test::threadCost();
    const double start = threadMilliseconds();
    last = replay.step(solver);
    times.push_back(threadMilliseconds() - start);
    heap_calls += (test::threadCost() - before).heap_calls;
    sum.solve_work += last.solve_work;
    sum.update_work += last.update_work;
    sum.build_work += last.build_work;
    sum.factors_replaced += last.factors_replaced;
    sum.iterations += last.iterations;
  }
  const double optimum = optimize(graph, {}).chi2;
  const double steps = static_cast<double>(times.size());
  double total = 0;
  for (const double t : times) total += t;
  std::sort(times.begin(), times.end());
  const auto at = [&](double q) { return times[static_cast<std::size_t>(q * (steps - 1))]; };
  std::printf("%s: %zu steps, %.3f s\n", path.substr(path.rfind('/') + 1).c_str(), times.size(),
              1e-3 * total);
  std::printf("  step: mean %.3f p50 %.3f p99 %.3f max %.3f ms, %.3f heap calls\n", total / steps, at(0.5),
              at(0.99), times.back(), static_cast<double>(heap_calls) / steps);
  std::printf(
      "  chi2 %.6f after the last step (batch %.6f); memory %.1f MB; factor %lld blocks, %lld dropped\n",
      last.chi2, optimum, 1e-6 * static_cast<double>(solver.memoryBytes()),
      static_cast<long long>(solver.factorBlocks()), static_cast<long long>(solver.fillDropped()));
  std::printf("  a step: %.2f iterations, %.3f new factors; work: solve %.0f, update %.0f, build %.0f\n",
              sum.iterations / steps, sum.factors_replaced / steps,
              static_cast<double>(sum.solve_work) / steps, static_cast<double>(sum.update_work) / steps,
              static_cast<double>(sum.build_work) / steps);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> paths(argv + 1, argv + argc);
  if (paths.empty())
    for (const char* name : {"tinyGrid3D", "parking-garage", "sphere2500"})
      paths.push_back(std::string(FATHOM_DATA_DIR "/posegraph/") + name + ".g2o");
  for (const std::string& path : paths) report(path);
}

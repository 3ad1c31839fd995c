// Report on the incremental solver: the three pose graphs of tests/slam, pose by pose, each step timed on the
// thread's own clock. Usage: report_slam [graph.g2o ...]
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

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
  const PoseGraph graph = readG2o(path);
  IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size());
  IncrementalSolver solver(config);
  PoseReplay replay(graph);
  std::vector<double> times;
  times.reserve(graph.poses.size());
  std::uint64_t heap_calls = 0;
  double solve = 0, update = 0, build = 0;
  int swaps = 0, iterations = 0;
  while (!replay.done()) {
    const test::ThreadCost before = test::threadCost();
    const double start = threadMilliseconds();
    const StepReport step = replay.step(solver);
    times.push_back(threadMilliseconds() - start);
    heap_calls += (test::threadCost() - before).heap_calls;
    solve += step.solve_work;
    update += step.update_work;
    build += step.build_work;
    swaps += step.factor_replaced;
    iterations += step.iterations;
  }
  const double n = times.size();
  double sum = 0;
  for (double t : times) sum += t;
  std::sort(times.begin(), times.end());
  const auto at = [&](double q) { return times[static_cast<std::size_t>(q * (n - 1))]; };
  std::printf(
      "%-28s %5zu steps  mean %.3f p50 %.3f p99 %.3f max %.3f ms  chi2 %.6f heap %lu  %.1f MB blocks %ld\n"
      "    work/step solve %.0f update %.0f build %.0f iterations %.2f swaps %d dropped %ld\n",
      path.substr(path.rfind('/') + 1).c_str(), times.size(), sum / n, at(.5), at(.99), times.back(),
      solver.chi2(), heap_calls, solver.memoryBytes() / 1e6, solver.factorBlocks(), solve / n, update / n,
      build / n, iterations / n, swaps, solver.fillDropped());
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> paths(argv + 1, argv + argc);
  if (paths.empty())
    for (const char* name : {"tinyGrid3D", "parking-garage", "sphere2500"})
      paths.push_back(std::string(FATHOM_DATA_DIR "/posegraph/") + name + ".g2o");
  for (const std::string& path : paths) report(path);
}

#include "tests/bench/slam/step_times.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <fstream>

#include "realtime/kernel/heap_counter.hpp"
#include "recon/slam/pose_replay.hpp"

namespace fathom::bench {
namespace {

double wallMilliseconds() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t residentBytes() {
  std::ifstream statm("/proc/self/statm");
  std::int64_t size = 0, resident = 0;
  statm >> size >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

}  // namespace

double threadMilliseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

Quantiles quantilesOf(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  double sum = 0;
  for (const double v : values) sum += v;
  const double last = static_cast<double>(values.size() - 1);
  const auto at = [&](double q) { return values[static_cast<std::size_t>(q * last + 0.5)]; };
  return {sum / static_cast<double>(values.size()), at(0.5), at(0.99), at(0.999), values.back()};
}

StepTimes timeSteps(const slam::PoseGraph& graph, slam::IncrementalSolver& solver) {
  slam::PoseReplay replay(graph);
  StepTimes times;
  std::vector<double> thread, wall;
  thread.reserve(graph.poses.size());
  wall.reserve(graph.poses.size());
  times.resident_before = residentBytes();
  while (!replay.done()) {
    const rt::ThreadCost before = rt::threadCost();
    const double start = threadMilliseconds(), wall_start = wallMilliseconds();
    const slam::StepReport step = replay.step(solver);
    wall.push_back(wallMilliseconds() - wall_start);
    thread.push_back(threadMilliseconds() - start);
    times.heap_calls += (rt::threadCost() - before).heap_calls;
    times.sum.solve_work += step.solve_work;
    times.sum.update_work += step.update_work;
    times.sum.build_work += step.build_work;
    times.sum.factors_replaced += step.factors_replaced;
    times.sum.iterations += step.iterations;
    times.steps_waiting += step.waits_for_factor ? 1 : 0;
    times.most_blocks = std::max(times.most_blocks, solver.factorBlocks());
    times.most_store = std::max(times.most_store, solver.factorStoreUsed());
    times.last = step;
  }
  times.resident_after = residentBytes();
  times.thread_ms = quantilesOf(thread);
  times.wall_ms = quantilesOf(wall);
  for (const double t : thread) times.seconds += 1e-3 * t;
  times.chi2 = times.last.chi2;
  return times;
}

void print(const std::string& name, const StepTimes& times, const slam::IncrementalSolver& solver) {
  const auto line = [](const char* what, const Quantiles& q) {
    std::printf("  %s: mean %.3f p50 %.3f p99 %.3f p99.9 %.3f max %.3f ms\n", what, q.mean, q.p50, q.p99,
                q.p999, q.max);
  };
  const double steps = solver.size(), megabyte = 1e-6;
  std::printf("%s: %d poses, %d measurements, %.3f s\n", name.c_str(), solver.size(), solver.measurements(),
              times.seconds);
  line("step, thread time", times.thread_ms);
  line("step, wall clock ", times.wall_ms);
  std::printf("  chi2 %.6f after the last step; %.3f heap calls a step; %d steps waited for a factor\n",
              times.chi2, static_cast<double>(times.heap_calls) / steps, times.steps_waiting);
  std::printf("  memory %.1f MB; resident %.1f MB before, %.1f MB after the steps\n",
              megabyte * static_cast<double>(solver.memoryBytes()),
              megabyte * static_cast<double>(times.resident_before),
              megabyte * static_cast<double>(times.resident_after));
  std::printf("  factor: %lld blocks, at most %lld (store %lld of %lld), %d measurements left out\n",
              static_cast<long long>(solver.factorBlocks()), static_cast<long long>(times.most_blocks),
              static_cast<long long>(times.most_store), static_cast<long long>(solver.factorStore()),
              solver.leftOut());
  std::printf("  a step: %.2f iterations, %.3f new factors; work: solve %.0f, update %.0f, build %.0f\n",
              times.sum.iterations / steps, times.sum.factors_replaced / steps,
              static_cast<double>(times.sum.solve_work) / steps,
              static_cast<double>(times.sum.update_work) / steps,
              static_cast<double>(times.sum.build_work) / steps);
}

}  // namespace fathom::bench

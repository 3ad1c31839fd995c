// Report on the incremental solver: pose graphs given pose by pose, each step timed.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "realtime/kernel/heap_counter.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/slam/batch_solver.hpp"
#include "recon/slam/g2o_file.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/pose_replay.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/bench/slam/ceres_peer.hpp"
#include "tests/slam/survey_graph.hpp"

namespace fathom::bench {
namespace {

// One graph given pose by pose.
struct StepTimes {
  std::vector<double> thread_ms, wall_ms;  // of each step
  std::uint64_t heap_calls = 0;
  std::int64_t resident_before = 0, resident_after = 0;  // of the process, around the steps [bytes]
  slam::StepReport sum, last;                            // work of all steps; the last step
  std::int64_t most_blocks = 0, most_store = 0;          // of a factor, at any step
  int steps_waiting = 0;                                 // in which poses waited for a factor
  double chi2 = 0;                                       // at the end
};
std::int64_t residentBytes() {
  std::ifstream statm("/proc/self/statm");
  std::int64_t size = 0, resident = 0;
  statm >> size >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

StepTimes timeSteps(const slam::PoseGraph& graph, slam::IncrementalSolver& solver) {
  slam::PoseReplay replay(graph);
  StepTimes times;
  times.thread_ms.reserve(graph.poses.size());
  times.wall_ms.reserve(graph.poses.size());
  times.resident_before = residentBytes();
  while (!replay.done()) {
    const rt::ThreadCost before = rt::threadCost();
    const double start = cpuMs(), wall_start = wallMs();
    const slam::StepReport step = replay.step(solver);
    times.wall_ms.push_back(wallMs() - wall_start);
    times.thread_ms.push_back(cpuMs() - start);
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
  times.chi2 = times.last.chi2;
  return times;
}

void print(const std::string& name, const StepTimes& times, const slam::IncrementalSolver& solver) {
  const auto line = [](const char* what, const std::vector<double>& ms) {
    std::printf("  %s: mean %.3f p50 %.3f p99 %.3f p99.9 %.3f max %.3f ms\n", what, meanOf(ms),
                quantile(ms, 0.5), quantile(ms, 0.99), quantile(ms, 0.999), quantile(ms, 1));
  };
  const double steps = solver.size(), megabyte = 1e-6;
  std::printf("%s: %d poses, %d measurements, %.3f s\n", name.c_str(), solver.size(), solver.measurements(),
              1e-3 * steps * meanOf(times.thread_ms));
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

void report(const std::string& name, slam::PoseGraph graph, std::int64_t blocks) {
  const auto closures =
      static_cast<int>(std::count_if(graph.edges.begin(), graph.edges.end(), [](const slam::RelativePose& e) {
        return e.from != slam::kWorld && std::abs(e.to - e.from) > 1;
      }));
  slam::IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size());
  config.max_factor_blocks =
      blocks > 0 ? blocks : slam::IncrementalConfig::blocksFor(config.max_poses, closures);
  slam::IncrementalSolver solver(config);
  print(name, timeSteps(graph, solver), solver);
}

// The whole graph at once, ours and Ceres in turns on one thread, timed by its own clock; each
// the best of some runs. From the same poses: those of
// the file, where ours tries a chordal start as well, and the chordal ones.
void compareWithCeres(const std::string& name, const slam::PoseGraph& graph) {
  constexpr int kRuns = 3;
  slam::PoseGraph chordal = graph;
  chordal.poses = slam::chordalPoses(graph);
  for (const slam::PoseGraph* start : {&graph, static_cast<const slam::PoseGraph*>(&chordal)}) {
    double ours = 0, ours_chi2 = 0;
    CeresOutcome best;
    for (int run = 0; run < kRuns; ++run) {
      slam::PoseGraph mine = *start, theirs = *start;
      const double begin = cpuMs();
      ours_chi2 = slam::optimize(mine, {}).chi2;
      const double seconds = 1e-3 * (cpuMs() - begin);
      ours = run == 0 ? seconds : std::min(ours, seconds);
      const CeresOutcome peer = solveByCeres(theirs);
      if (run == 0 || peer.seconds < best.seconds) best = peer;
    }
    std::printf(
        "%s from %s poses: ours %.3f s, chi2 %.6f; Ceres %.3f s, chi2 %.6f (%d iterations, %s), by its "
        "default "
        "trust region %.3f s: ours is %.2f and %.2f times faster\n",
        name.c_str(), start == &graph ? "the file's" : "chordal", ours, ours_chi2, best.seconds, best.chi2,
        best.iterations, best.options.c_str(), best.usual_seconds, best.seconds / ours,
        best.usual_seconds / ours);
  }
}

struct Options {
  std::vector<std::string> graphs;
  test::SurveyPlan plan;
  bool survey = false, anywhere = false, ceres = false;
  std::int64_t blocks = 0;
};

int run(Options o) {
  if (o.survey) {
    if (o.anywhere) o.plan.where = test::Closures::kAnywhere;
    report("survey", test::makeSurvey(o.plan).graph, o.blocks);
    return kExitSuccess;
  }
  if (o.graphs.empty())
    for (const char* name : {"tinyGrid3D", "parking-garage", "sphere2500"})
      o.graphs.push_back(std::string(FATHOM_DATA_DIR "/posegraph/") + name + ".g2o");
  for (const std::string& file : o.graphs) {
    const std::string name = file.substr(file.rfind('/') + 1);
    if (o.ceres) {
      compareWithCeres(name, slam::readG2o(file));
      continue;
    }
    report(name, slam::readG2o(file), o.blocks);
  }
  return kExitSuccess;
}

}  // namespace

test::Report slamReport() {
  static Options o;
  return {"slam",
          "Times of the incremental solver, a pose graph given pose by pose",
          {
              {"graphs", &o.graphs, "g2o files; without any, the three graphs that the tests use"},
              {"--survey", &o.survey, "a made-up survey instead"},
              {"--keyframes", &o.plan.keyframes, "of the survey"},
              {"--closures", &o.plan.closures, "of the survey"},
              {"--anywhere", &o.anywhere, "closures join any two keyframes"},
              {"--sensors", &o.plan.attitude_and_depth, "attitude and depth of every keyframe"},
              {"--blocks", &o.blocks, "room of a factor; without it by IncrementalConfig::blocksFor"},
              {"--ceres", &o.ceres, "the whole graph at once instead, ours against Ceres"},
          },
          [] { return run(o); }};
}

}  // namespace fathom::bench

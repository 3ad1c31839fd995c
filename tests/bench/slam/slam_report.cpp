// Report on the incremental solver: pose graphs given pose by pose, each step timed.
#include <ceres/ceres.h>
#include <unistd.h>
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/memory/heap_counter.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "recon/solver/incremental/pose_replay.hpp"
#include "recon/solver/pose_graph.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/world/graphs.hpp"
#include "tests/world/hostile_dives.hpp"

namespace fathom::bench {
namespace {

constexpr int kNumbers = 7, kTangent = 6;  // translation, quaternion x y z w
using Pose = std::array<double, kNumbers>;

SE3 poseOf(const double* x) {
  return {Eigen::Quaterniond(x[6], x[3], x[4], x[5]), {x[0], x[1], x[2]}};
}

void write(const SE3& pose, double* x) {
  Eigen::Map<Eigen::Vector3d>{x} = pose.translation();
  Eigen::Map<Eigen::Vector4d>{x + 3} = pose.rotation().coeffs();
}

// Right perturbations (rho, phi). Residuals give their derivatives by these in the first six columns, so that
// the chain rule through the seven numbers costs nothing.
class RightPerturbation : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kNumbers; }
  int TangentSize() const override { return kTangent; }
  bool Plus(const double* x, const double* delta, double* result) const override {
    write(perturbed(poseOf(x), Eigen::Map<const Vector6d>(delta)), result);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, kNumbers, kTangent, Eigen::RowMajor>>{jacobian}.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Vector6d>{y_minus_x} = (poseOf(x).inverse() * poseOf(y)).log();
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, kTangent, kNumbers, Eigen::RowMajor>>{jacobian}.setIdentity();
    return true;
  }
};

class Edge : public ceres::SizedCostFunction<6, kNumbers, kNumbers> {
 public:
  explicit Edge(const slam::RelativePose& edge)
      : edge_(edge), root_(edge.information.llt().matrixL().transpose()) {}
  bool Evaluate(const double* const* x, double* residual, double** jacobians) const override {
    const SE3 from = poseOf(x[0]), to = poseOf(x[1]);
    Eigen::Map<Vector6d> e(residual);
    if (jacobians == nullptr) {
      e = root_ * slam::relativePoseError(edge_, from, to);
      return true;
    }
    const slam::RelativePoseLinear l = slam::linearize(edge_, from, to);
    e = root_ * l.error;
    for (int end = 0; end < 2; ++end) {
      if (jacobians[end] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, 6, kNumbers, Eigen::RowMajor>> j(jacobians[end]);
      j.leftCols<kTangent>() = root_ * (end == 0 ? l.by_from : l.by_to);
      j.col(kNumbers - 1).setZero();
    }
    return true;
  }

 private:
  slam::RelativePose edge_;
  Matrix6d root_;
};

struct CeresOutcome {
  double seconds = 0;  // of ceres::Solve alone, thread time
  double chi2 = 0;
  int iterations = 0;
  std::string options;
  double usual_seconds = 0;  // with Ceres' default trust region instead
};

CeresOutcome solve(const slam::PoseGraph& graph, ceres::TrustRegionStrategyType strategy, double radius,
                   std::vector<Pose>& x) {
  x.resize(graph.poses.size());
  for (std::size_t i = 0; i < x.size(); ++i) write(graph.poses[i], x[i].data());
  ceres::Problem problem;
  for (Pose& pose : x) problem.AddParameterBlock(pose.data(), kNumbers, new RightPerturbation);
  problem.SetParameterBlockConstant(x.front().data());
  for (const slam::RelativePose& e : graph.edges)
    problem.AddResidualBlock(new Edge(e), nullptr, x[static_cast<std::size_t>(e.from)].data(),
                             x[static_cast<std::size_t>(e.to)].data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  options.trust_region_strategy_type = strategy;
  options.initial_trust_region_radius = radius;
  options.max_trust_region_radius = std::max(options.max_trust_region_radius, radius);
  options.num_threads = 1;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-9;  // as ours
  options.gradient_tolerance = options.parameter_tolerance = 0;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  const double start = cpuMs();
  ceres::Solve(options, &problem, &summary);
  return CeresOutcome{.seconds = 1e-3 * (cpuMs() - start),
                      .chi2 = 2 * summary.final_cost,
                      .iterations = static_cast<int>(summary.iterations.size()) - 1,
                      .options = std::string(strategy == ceres::DOGLEG ? "dogleg" : "Levenberg-Marquardt") +
                                 ", radius " + std::to_string(static_cast<long long>(radius))};
}

// The same graph by Ceres from the graph's poses, which become the solution: sparse normal Cholesky by
// SuiteSparse, analytic derivatives in the tangent space, one thread; the quickest of its trust region
// methods among those that reach the least chi2.
CeresOutcome solveByCeres(slam::PoseGraph& graph) {
  constexpr double kUsual = 1e4, kWide = 1e12, kEqual = 1 + 1e-5;
  std::vector<CeresOutcome> outcomes;
  std::vector<std::vector<Pose>> solutions;
  for (const auto strategy : {ceres::LEVENBERG_MARQUARDT, ceres::DOGLEG}) {
    for (const double radius : {kUsual, kWide}) {
      solutions.emplace_back();
      outcomes.push_back(solve(graph, strategy, radius, solutions.back()));
    }
  }
  double least = outcomes.front().chi2;
  for (const CeresOutcome& o : outcomes) least = std::min(least, o.chi2);
  std::size_t best = outcomes.size();
  for (std::size_t i = 0; i < outcomes.size(); ++i)
    if (outcomes[i].chi2 <= kEqual * least &&
        (best == outcomes.size() || outcomes[i].seconds < outcomes[best].seconds))
      best = i;
  for (std::size_t i = 0; i < graph.poses.size(); ++i) graph.poses[i] = poseOf(solutions[best][i].data());
  outcomes[best].usual_seconds = outcomes.front().seconds;
  return outcomes[best];
}

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

void reportSteps(const std::string& name, slam::PoseGraph graph, std::int64_t blocks) {
  const auto closures =
      static_cast<int>(std::count_if(graph.edges.begin(), graph.edges.end(), [](const slam::RelativePose& e) {
        return e.from != slam::kWorld && std::abs(e.to - e.from) > 1;
      }));
  slam::IncrementalConfig config{.max_poses = static_cast<int>(graph.poses.size()),
                                 .max_measurements = static_cast<int>(graph.edges.size())};
  config.max_factor_blocks =
      blocks > 0 ? blocks : slam::IncrementalConfig::blocksFor(config.max_poses, closures);
  slam::IncrementalSolver solver(config);
  print(name, timeSteps(graph, solver), solver);
}

// The whole graph at once, ours and Ceres in turns on one thread, timed by its own clock; each the best of
// some runs. From the same poses: those of the file, where ours tries a chordal start as well, and the
// chordal ones.
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

struct SlamOptions {
  std::vector<std::string> graphs;
  test::SurveyPlan plan;
  bool survey = false, anywhere = false, ceres = false;
  std::int64_t blocks = 0;
};

int runSlam(SlamOptions o) {
  if (o.survey) {
    if (o.anywhere) o.plan.where = test::Closures::kAnywhere;
    reportSteps("survey", test::makeSurvey(o.plan).graph, o.blocks);
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
    reportSteps(name, slam::readG2o(file), o.blocks);
  }
  return kExitSuccess;
}

// Synthetic dives with false sensor data: position error, against a solution without the false data.
struct HostileOptions {
  int seeds = 20;
  std::string only;
};

int runHostile(const HostileOptions& o) {
  using slam::testing::runHostile;
  constexpr double kLost = 10;  // [m]
  constexpr double kWorse = 2;  // times the error of the solution without the false data
  std::printf(
      "runs beyond 10 m, beyond twice the error without the false data; worst error (without the false "
      "data)\n");
  std::printf("%-44s %-27s %-27s %s\n", "", "on board, live", "on board, after", "topside");
  int lost = 0, runs = 0;
  for (const auto& dive : slam::testing::hostileDives()) {
    if (dive.name.find(o.only) == std::string::npos) continue;
    int beyond[3] = {}, worse[3] = {};
    double worst[3] = {}, clean[3] = {};
    for (int seed = 1; seed <= o.seeds; ++seed) {
      const auto [e, t] = runHostile(dive, static_cast<std::uint64_t>(seed));
      const double errors[3] = {e.live, e.after, e.topside}, best[3] = {t.live, t.after, t.topside};
      for (int i = 0; i < 3; ++i) {
        beyond[i] += errors[i] > kLost ? 1 : 0;
        worse[i] += errors[i] > kWorse * best[i] ? 1 : 0;
        worst[i] = std::max(worst[i], errors[i]);
        clean[i] = std::max(clean[i], best[i]);
        lost += errors[i] > kLost ? 1 : 0;
        ++runs;
      }
    }
    std::printf("%-44s", dive.name.c_str());
    for (int i = 0; i < 3; ++i)
      std::printf(" %3d %3d %8.2f (%5.2f) m ", beyond[i], worse[i], worst[i], clean[i]);
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf("%d of %d runs beyond %.0f m\n", lost, runs, kLost);
  return lost == 0 ? 0 : 1;
}

}  // namespace

void hostileReport(CommandLine& program) {
  static HostileOptions o;
  CommandLine& command =
      program.command("hostile", "Position error on synthetic dives with false sensor data", "",
                      [] { return runHostile(o); });
  command.shown("--seeds", o.seeds, "runs of each dive", 1, 1000);
  command.add_option("--only", o.only, "dives with this in their name");
}

void slamReport(CommandLine& program) {
  static SlamOptions o;
  CommandLine& command =
      program.command("slam", "Times of the incremental solver, a pose graph given pose by pose", "",
                      [] { return runSlam(o); });
  command.add_option("graphs", o.graphs, "g2o files; without any, the three graphs that the tests use");
  command.add_flag("--survey", o.survey, "a synthetic survey instead");
  command.shown("--keyframes", o.plan.keyframes, "of the survey");
  command.shown("--closures", o.plan.closures, "of the survey");
  command.add_flag("--anywhere", o.anywhere, "closures join any two keyframes");
  command.add_flag("--sensors", o.plan.attitude_and_depth, "attitude and depth of every keyframe");
  command.shown("--blocks", o.blocks, "room of a factor; without it by IncrementalConfig::blocksFor");
  command.add_flag("--ceres", o.ceres, "the whole graph at once instead, ours against Ceres");
}

}  // namespace fathom::bench

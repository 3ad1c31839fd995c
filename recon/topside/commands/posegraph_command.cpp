#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "realtime/kernel/memory/heap_counter.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/incremental/pose_replay.hpp"
#include "recon/solver/pose_graph.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

struct PosegraphOptions {
  std::filesystem::path file, out, truth;
  bool json = false, details = false, incremental = false, nearest_positive = false;
};

// True places of the poses from a chain of TORO lines, EDGE3 i i+1 x y z roll pitch yaw ..., which is how the
// truth of the sphere is published; lines between other poses are passed over.
std::vector<Eigen::Vector3d> readTruth(const std::filesystem::path& path, std::size_t poses) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path))
    throw InputError(path.string(), "", "is absent or cannot be read; give the true poses");
  std::vector<std::optional<SE3>> chain(poses);
  std::string line, kind;
  for (std::size_t number = 1; std::getline(in, line); ++number) {
    std::istringstream fields(line);
    std::size_t from = 0, to = 0;
    double x = 0, y = 0, z = 0, roll = 0, pitch = 0, yaw = 0;
    if (!(fields >> kind) || kind != "EDGE3") continue;
    if (!(fields >> from >> to >> x >> y >> z >> roll >> pitch >> yaw))
      throw InputError(path.string(), "line " + std::to_string(number), "is no whole EDGE3");
    if (to == from + 1 && to < poses) chain[to] = SE3::fromEuler(roll, pitch, yaw, {x, y, z});
  }
  std::vector<Eigen::Vector3d> places{Eigen::Vector3d::Zero()};
  SE3 pose;
  for (std::size_t i = 1; i < poses; ++i) {
    if (!chain[i])
      throw InputError(path.string(), "EDGE3",
                       "says nothing of the motion from pose " + std::to_string(i - 1) + " to the next");
    pose = pose * *chain[i];
    places.push_back(pose.translation());
  }
  return places;
}

// Root mean square distance after the best rigid alignment [m].
double alignedError(const std::vector<SE3>& poses, const std::vector<Eigen::Vector3d>& truth) {
  const auto n = static_cast<Eigen::Index>(poses.size());
  Eigen::Matrix3Xd a(3, n), b(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    a.col(i) = poses[static_cast<std::size_t>(i)].translation();
    b.col(i) = truth[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix4d T = rigidAlignment(a, b);
  const Eigen::Matrix3Xd moved =
      (T.topLeftCorner<3, 3>() * a).colwise() + Eigen::Vector3d(T.topRightCorner<3, 1>());
  return std::sqrt((moved - b).colwise().squaredNorm().mean());
}

Json timesOf(std::vector<double> ms) {
  std::sort(ms.begin(), ms.end());
  double sum = 0;
  for (const double v : ms) sum += v;
  const auto at = [&](double q) {
    return ms.empty() ? 0.0 : ms[static_cast<std::size_t>(std::ceil(q * static_cast<double>(ms.size() - 1)))];
  };
  return {{"mean", ms.empty() ? 0.0 : sum / static_cast<double>(ms.size())},
          {"p50", at(0.5)},
          {"p99", at(0.99)},
          {"max", at(1)}};
}

// What both solvers report, in this order.
Json reportOf(double chi2, std::size_t poses, const std::vector<double>& step_ms, std::uint64_t heap_calls,
              std::size_t memory_bytes, double seconds) {
  const double steps = static_cast<double>(step_ms.size());
  return {{"chi2", chi2},
          {"poses", poses},
          {"steps", step_ms.size()},
          {"step_ms", timesOf(step_ms)},
          {"heap_calls_per_step", step_ms.empty() ? 0.0 : static_cast<double>(heap_calls) / steps},
          {"memory_bytes", memory_bytes},
          {"total_s", seconds}};
}

// This thread's own time: on a busy machine the clock also counts other programs.
double threadMilliseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

// Pose by pose, as they would have come on board; the file's poses are not used, but for the first.
int runIncremental(const PosegraphOptions& options, slam::PoseGraph& graph,
                   const std::vector<Eigen::Vector3d>& truth) {
  slam::IncrementalConfig config;
  config.max_poses = std::max(1, static_cast<int>(graph.poses.size()));
  config.max_measurements = std::max(1, static_cast<int>(graph.edges.size()));
  config.max_factor_blocks = slam::IncrementalConfig::blocksFor(
      config.max_poses, std::max(0, config.max_measurements - config.max_poses));
  slam::IncrementalSolver solver(config);
  slam::PoseReplay replay(graph);
  slam::StepReport last;
  Stopwatch total, lap;
  std::vector<double> step_ms, step_cpu_ms;
  std::uint64_t heap_calls = 0;
  step_ms.reserve(graph.poses.size());
  step_cpu_ms.reserve(graph.poses.size());
  while (!replay.done()) {
    lap.lap();
    const double before = threadMilliseconds();
    const rt::ThreadCost cost = rt::threadCost();
    last = replay.step(solver);
    heap_calls += (rt::threadCost() - cost).heap_calls;
    step_cpu_ms.push_back(threadMilliseconds() - before);
    step_ms.push_back(1e3 * lap.lap());
  }
  const double seconds = total.lap();
  for (std::size_t i = 0; i < graph.poses.size(); ++i) graph.poses[i] = solver.pose(static_cast<int>(i));
  if (!options.out.empty()) slam::writeG2o(options.out, graph);
  if (options.json) {
    Json json = reportOf(last.chi2, graph.poses.size(), step_ms, heap_calls, solver.memoryBytes(), seconds);
    if (options.details) {
      json["edges"] = graph.edges.size();
      json["step_cpu_ms"] = timesOf(step_cpu_ms);
      json["waits_for_factor"] = last.waits_for_factor;
      json["factor_blocks"] = solver.factorBlocks();
      json["measurements_left_out"] = solver.leftOut();
    }
    if (!truth.empty()) json["rms_error_m"] = alignedError(graph.poses, truth);
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("%zu poses, %zu edges: chi2 %.6f after the last of %zu steps, %.3f s\n", graph.poses.size(),
                graph.edges.size(), last.chi2, step_ms.size(), seconds);
    if (!truth.empty())
      std::printf("root mean square distance from the truth, aligned: %.4f m\n",
                  alignedError(graph.poses, truth));
  }
  return kExitSuccess;
}

int runPosegraph(const PosegraphOptions& options) {
  int made_positive = 0;
  slam::PoseGraph graph = slam::readG2o(options.file, options.nearest_positive ? &made_positive : nullptr);
  if (made_positive > 0)
    std::fprintf(stderr,
                 "fathom-topside: information matrices of %d of %zu edges are not positive semidefinite; the "
                 "nearest that are take their place\n",
                 made_positive, graph.edges.size());
  const auto truth =
      options.truth.empty() ? std::vector<Eigen::Vector3d>{} : readTruth(options.truth, graph.poses.size());
  if (options.incremental) return runIncremental(options, graph, truth);
  Stopwatch total, lap;
  std::vector<double> step_ms;
  const rt::ThreadCost before = rt::threadCost();
  const slam::BatchResult result = slam::optimize(graph, {}, [&](int iteration, double chi2) {
    step_ms.push_back(1e3 * lap.lap());
    if (!options.json) std::fprintf(stderr, "iteration %d: chi2 %.6f\n", iteration, chi2);
  });
  const double seconds = total.lap();
  const std::uint64_t heap_calls = (rt::threadCost() - before).heap_calls;
  if (!options.out.empty()) slam::writeG2o(options.out, graph);
  if (options.json) {
    Json json = reportOf(result.chi2, graph.poses.size(), step_ms, heap_calls, result.memory_bytes, seconds);
    if (options.details) {
      json["edges"] = graph.edges.size();
      json["chi2_given"] = result.chi2_given;
      json["chi2_start"] = result.chi2_start;
      json["start"] = result.chordal ? "chordal" : "given";
      json["converged"] = result.converged;
      json["factor_entries"] = result.factor_entries;
    }
    if (!truth.empty()) json["rms_error_m"] = alignedError(graph.poses, truth);
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("%zu poses, %zu edges: chi2 %.6f after %d iterations from %.6f (%s), %.3f s\n",
                graph.poses.size(), graph.edges.size(), result.chi2, result.iterations, result.chi2_start,
                result.chordal ? "chordal start" : "the file's poses", seconds);
    if (!truth.empty())
      std::printf("root mean square distance from the truth, aligned: %.4f m\n",
                  alignedError(graph.poses, truth));
  }
  if (!result.converged) {
    std::fprintf(stderr, "fathom-topside: not converged; chi2 may still fall\n");
    return kExitFailedWork;
  }
  return kExitSuccess;
}

}  // namespace

void addPosegraphCommand(CommandLine& app) {
  const auto options = std::make_shared<PosegraphOptions>();
  CommandLine& command = app.command("posegraph", "optimise a graph of 3D poses in g2o's form",
                                     "Example: fathom-topside posegraph graph.g2o --out optimised.g2o",
                                     [options] { return runPosegraph(*options); });
  command.add_option("file", options->file, "g2o file: VERTEX_SE3:QUAT, EDGE_SE3:QUAT")->required();
  command.add_option("--out", options->out, "g2o file to write");
  command.add_option("--truth", options->truth, "EDGE3 chain of true relative poses, to compare places with");
  command.add_flag("--incremental", options->incremental,
                   "pose by pose in fixed memory, as on board, instead of all at once");
  command.add_flag("--nearest-positive", options->nearest_positive,
                   "replace information matrices that are not positive semidefinite by the nearest that are");
  command.add_flag("--json", options->json, "print one JSON object");
  command.add_flag("--details", options->details, "add to the JSON what the solver did")->needs("--json");
}

}  // namespace fathom::topside

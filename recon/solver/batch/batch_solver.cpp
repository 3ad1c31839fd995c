#include "recon/solver/batch/batch_solver.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/solver/batch/block_cholesky.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

constexpr double kFirstDamping = 1e-6;  // share added to the diagonal
constexpr double kMostDamping = 1e6;
constexpr double kEasing = 0.1;  // of the damping after a step that helped
// In a long, curved valley (a garage of 1,661 poses) a whole step leads up its side, and the next one far
// down. So many steps may rise, up to this factor, before the best poses are taken up again (the watchdog of
// Chamberlain, Powell, Lemarechal & Pedersen 1982).
constexpr int kUphill = 2;
constexpr double kSteepest = 4;

// Poses that are solved for, and edges between two of them; the first pose of each connected part is held.
struct Unknowns {
  std::vector<int> of_pose;  // -1: held
  int count = 0;
  std::vector<BlockCholesky::Pair> pairs;  // from, to
  std::vector<int> pair_of_edge;           // -1: an end is held
};

Unknowns unknownsOf(const PoseGraph& graph) {
  UnionFind parts(graph.poses.size());
  for (const RelativePose& e : graph.edges)
    parts.join(static_cast<std::uint32_t>(e.from), static_cast<std::uint32_t>(e.to));
  Unknowns u;
  for (std::uint32_t i = 0; i < graph.poses.size(); ++i)
    u.of_pose.push_back(parts.root(i) == i ? -1 : u.count++);
  for (const RelativePose& e : graph.edges) {
    const int a = u.of_pose[at(e.from)], b = u.of_pose[at(e.to)];
    u.pair_of_edge.push_back(a < 0 || b < 0 ? -1 : static_cast<int>(u.pairs.size()));
    if (a >= 0 && b >= 0) u.pairs.push_back({a, b});
  }
  return u;
}

void validate(const PoseGraph& graph) {
  const int poses = static_cast<int>(graph.poses.size());
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    const RelativePose& e = graph.edges[k];
    const auto refuse = [&](const char* what) {
      throw std::invalid_argument("pose graph: edge " + std::to_string(k) + " " + what);
    };
    if (e.from < 0 || e.to < 0 || e.from >= poses || e.to >= poses) refuse("names a pose that is not there");
    if (e.from == e.to) refuse("joins a pose to itself");
    if (!e.information.allFinite() ||
        (e.information - e.information.transpose()).norm() > 1e-9 * e.information.norm() ||
        !isPositive(e.information))
      refuse("has an information matrix that is not symmetric and positive semidefinite");
  }
}

// Sum over edges of weight ||x_to - M^T x_from - c||^2 for columns x of Size rows, where held poses have the
// values that `held` gives; the least squares solution for the others, one column for each right side.
template <int Size, typename Weight, typename Turn, typename Constant, typename Held>
Eigen::MatrixXd linearLeastSquares(const PoseGraph& graph, const Unknowns& u, Weight weight, Turn turn,
                                   Constant constant, Held held) {
  using Square = Eigen::Matrix<double, Size, Size>;
  using Rows = Eigen::Matrix<double, Size, 3>;
  BlockCholesky system(u.count, Size, u.pairs);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(u.count * Size, 3);
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    const RelativePose& e = graph.edges[k];
    const double w = weight(e);
    const Square m = turn(e);
    const Rows c = constant(e);
    const int from = u.of_pose[at(e.from)], to = u.of_pose[at(e.to)];
    if (to >= 0) {
      system.addDiagonal(to, Square(w * Square::Identity()));
      right.middleRows<Size>(to * Size) += w * c;
      if (from < 0) right.middleRows<Size>(to * Size) += w * m.transpose() * Rows(held(e.from));
    }
    if (from >= 0) {
      system.addDiagonal(from, Square(w * m * m.transpose()));
      right.middleRows<Size>(from * Size) -= w * m * c;
      if (to < 0) right.middleRows<Size>(from * Size) += w * m * Rows(held(e.to));
    }
    if (u.pair_of_edge[k] >= 0) system.addPair(at(u.pair_of_edge[k]), Square(-w * m));
  }
  if (!system.factorize()) throw std::runtime_error("pose graph: the chordal system is singular");
  return system.solve(right);
}

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) sign(2, 2) = -1;
  return svd.matrixU() * sign * svd.matrixV().transpose();
}

// Fills the normal equations at the graph's poses; returns the gradient.
Eigen::VectorXd assemble(const PoseGraph& graph, const Unknowns& u, BlockCholesky& system) {
  system.setZero();
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(u.count * kBlockSize);
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    const RelativePose& e = graph.edges[k];
    const RelativePoseLinear l = linearize(e, graph.poses[at(e.from)], graph.poses[at(e.to)]);
    const int from = u.of_pose[at(e.from)], to = u.of_pose[at(e.to)];
    const Matrix6d weighted_from = l.by_from.transpose() * e.information;
    const Matrix6d weighted_to = l.by_to.transpose() * e.information;
    if (from >= 0) {
      system.addDiagonal6(from, weighted_from * l.by_from);
      gradient.segment<kBlockSize>(from * kBlockSize) += weighted_from * l.error;
    }
    if (to >= 0) {
      system.addDiagonal6(to, weighted_to * l.by_to);
      gradient.segment<kBlockSize>(to * kBlockSize) += weighted_to * l.error;
    }
    if (u.pair_of_edge[k] >= 0) system.addPair6(at(u.pair_of_edge[k]), weighted_from * l.by_to);
  }
  return gradient;
}

// Blocks of the factor of a whole graph, counted without making it.
std::int64_t blocksNeeded(const PoseGraph& graph) {
  const int poses = static_cast<int>(graph.poses.size()), edges = static_cast<int>(graph.edges.size());
  const GrowingFactor::Size factor_size{poses, poses, 0};
  const FactorBuilder::Size builder_size{poses, edges};
  rt::Arena arena(Measurements::bytes(poses, edges) + GrowingFactor::bytes(factor_size) +
                  FactorBuilder::bytes(builder_size));
  Measurements measurements(poses, edges, arena);
  for (const RelativePose& e : graph.edges) (void)measurements.add(e, poses);
  GrowingFactor factor(factor_size, arena);
  FactorBuilder builder(builder_size, arena);
  std::vector<std::uint8_t> held(graph.poses.size(), 0);
  held.front() = 1;
  const std::vector<std::uint8_t> newest(graph.poses.size(), 0), left_out(graph.edges.size(), 0);
  builder.begin(graph.poses, held, newest, left_out, measurements, 0, factor);
  return builder.blocks();
}

// Solves by the solver that runs on board, without quotas: its factor of blocks is quicker to build than
// CHOLMOD's, and one that is slightly old still serves. False when it cannot hold the graph or does not
// converge; the graph then has the best poses so far.
bool solveByGrowingFactor(PoseGraph& graph, const BatchOptions& options, BatchResult& result,
                          const std::function<void(int iteration, double chi2)>& progress) {
  constexpr int kStalled = 20;  // steps without a move: while damping grows, poses wait
  constexpr std::int64_t kNoQuota = std::int64_t{1} << 40;
  IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size());
  config.max_measurements = static_cast<int>(graph.edges.size());
  // The solver keeps an eighth free for what may come.
  constexpr std::int64_t kLeastBlocks = 64;
  config.max_factor_blocks = blocksNeeded(graph) * 8 / 7 + kLeastBlocks;
  config.build_quota = config.urgent_quota = kNoQuota;
  config.update_quota = 1;
  config.kept_last = 0;
  config.least_decrease = options.min_decrease;
  config.least_effect = config.continue_from = 0;
  IncrementalSolver solver(config);
  result.converged = false;
  for (const SE3& pose : graph.poses)
    if (solver.addPose(pose) != AddStatus::kOk) return false;
  for (const RelativePose& e : graph.edges)
    if (solver.addMeasurement(e) != AddStatus::kOk) return false;
  for (int stalled = 0;
       stalled < kStalled && result.iterations < options.max_iterations && !result.converged;) {
    const StepReport step = solver.step();
    if (step.measurements_waiting > 0) return false;  // the factor has no room
    result.iterations += step.iterations;
    stalled = step.iterations == 0 ? stalled + 1 : 0;
    result.converged = !step.waits_for_factor && step.decrease_expected <= options.min_decrease * step.chi2 +
                                                                               IncrementalConfig::kNothing;
    if (progress) progress(result.iterations, step.chi2);
  }
  if (!(solver.chi2() <= result.chi2)) return result.converged = false;
  for (std::size_t i = 0; i < graph.poses.size(); ++i) graph.poses[i] = solver.pose(static_cast<int>(i));
  result.chi2 = solver.chi2();
  result.factor_entries = static_cast<double>(kBlockSize * kBlockSize * solver.factorBlocks());
  result.memory_bytes = solver.memoryBytes();
  return result.converged;
}

// Chordal poses in place of the given ones if their chi2 is less.
void takeChordalPoses(PoseGraph& graph, BatchResult& result) {
  PoseGraph other = graph;
  other.poses = chordalPoses(graph);
  const double chordal = chiSquare(other);
  if (chordal < result.chi2_start || !std::isfinite(result.chi2_start)) {
    graph.poses = std::move(other.poses);
    result.chi2_start = chordal;
    result.chordal = true;
  }
}

// Gauss-Newton with Marquardt's damping and the watchdog above.
void solveByCholesky(PoseGraph& graph, const Unknowns& u, const BatchOptions& options, BatchResult& result,
                     const std::function<void(int iteration, double chi2)>& progress) {
  BlockCholesky system(u.count, kBlockSize, u.pairs);
  PoseGraph best = graph;
  double damping = 0;
  int uphill = 0;  // steps since the best poses
  bool factored = false;
  while (!result.converged && result.iterations < options.max_iterations) {
    const Eigen::VectorXd gradient = assemble(graph, u, system);
    // By the last factor: whether another is worth its cost.
    if (factored && uphill == 0 && damping == 0 &&
        gradient.dot(system.solve(gradient).col(0)) <= options.min_decrease * result.chi2) {
      result.converged = true;
      break;
    }
    ++result.iterations;
    PoseGraph next = graph;
    double chi2 = NAN;
    factored = system.factorize(damping);
    if (factored) {
      const Eigen::VectorXd step = system.solve(-gradient);
      for (std::size_t i = 0; i < graph.poses.size(); ++i)
        if (u.of_pose[i] >= 0)
          next.poses[i] = perturbed(graph.poses[i], step.segment<kBlockSize>(u.of_pose[i] * kBlockSize));
      chi2 = chiSquare(next);
    }
    if (chi2 <= result.chi2) {
      result.converged = result.chi2 - chi2 <= options.min_decrease * chi2;
      result.chi2 = chi2;
      graph.poses.swap(next.poses);
      best.poses = graph.poses;
      damping = damping > kFirstDamping ? kEasing * damping : 0;
      uphill = 0;
    } else if (damping == 0 && uphill < kUphill && chi2 < kSteepest * result.chi2) {
      graph.poses.swap(next.poses);
      ++uphill;
    } else {
      graph.poses = best.poses;
      uphill = kUphill;
      damping = std::max(damping / kEasing, kFirstDamping);
      result.converged = damping > kMostDamping;  // a minimum, to rounding
    }
    if (progress) progress(result.iterations, result.chi2);
  }
  graph.poses = best.poses;
  result.factor_entries = system.factorEntries();
  result.memory_bytes = system.memoryBytes();
}

}  // namespace

std::vector<SE3> chordalPoses(const PoseGraph& graph) {
  validate(graph);
  const Unknowns u = unknownsOf(graph);
  std::vector<SE3> poses = graph.poses;
  if (u.count == 0) return poses;
  // R_to = R_from R_from_to; the rows of R, as columns x, follow x_to = R_from_to^T x_from.
  const Eigen::MatrixXd rows = linearLeastSquares<3>(
      graph, u, [](const RelativePose& e) { return e.information.diagonal().tail<3>().mean(); },
      [](const RelativePose& e) { return e.T_from_to.matrix3(); },
      [](const RelativePose&) { return Eigen::Matrix3d::Zero(); },
      [&](int pose) -> Eigen::Matrix3d { return graph.poses[at(pose)].matrix3().transpose(); });
  for (std::size_t i = 0; i < poses.size(); ++i)
    if (u.of_pose[i] >= 0)
      poses[i] =
          SE3(nearestRotation(rows.middleRows<3>(u.of_pose[i] * 3).transpose()), poses[i].translation());
  const Eigen::MatrixXd places = linearLeastSquares<1>(
      graph, u, [](const RelativePose& e) { return e.information.diagonal().head<3>().mean(); },
      [](const RelativePose&) { return Eigen::Matrix<double, 1, 1>::Identity(); },
      [&](const RelativePose& e) -> Eigen::RowVector3d {
        return (poses[at(e.from)].rotation() * e.T_from_to.translation()).transpose();
      },
      [&](int pose) -> Eigen::RowVector3d { return graph.poses[at(pose)].translation().transpose(); });
  for (std::size_t i = 0; i < poses.size(); ++i)
    if (u.of_pose[i] >= 0) poses[i] = SE3(poses[i].rotation(), places.row(u.of_pose[i]).transpose());
  return poses;
}

BatchResult optimize(PoseGraph& graph, const BatchOptions& options,
                     const std::function<void(int iteration, double chi2)>& progress) {
  validate(graph);
  BatchResult result;
  result.chi2_given = result.chi2_start = chiSquare(graph);
  const Unknowns u = unknownsOf(graph);
  if (u.count > 0 && options.chordal) takeChordalPoses(graph, result);
  result.chi2 = result.chi2_start;
  result.converged = u.count == 0;
  if (u.count == 0) return result;

  const bool in_one_piece = u.count + 1 == static_cast<int>(graph.poses.size());
  if (in_one_piece && solveByGrowingFactor(graph, options, result, progress)) return result;

  solveByCholesky(graph, u, options, result, progress);
  return result;
}

}  // namespace fathom::slam

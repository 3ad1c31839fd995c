#include "tests/bench/slam/ceres_peer.hpp"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <vector>

#include "tests/bench/common/measures.hpp"

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
  CeresOutcome outcome;
  outcome.seconds = 1e-3 * (cpuMs() - start);
  outcome.chi2 = 2 * summary.final_cost;
  outcome.iterations = static_cast<int>(summary.iterations.size()) - 1;
  outcome.options = std::string(strategy == ceres::DOGLEG ? "dogleg" : "Levenberg-Marquardt") + ", radius " +
                    std::to_string(static_cast<long long>(radius));
  return outcome;
}

}  // namespace

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

}  // namespace fathom::bench

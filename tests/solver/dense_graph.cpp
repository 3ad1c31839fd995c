#include "tests/solver/dense_graph.hpp"

#include <Eigen/Dense>

namespace fathom::slam {

Eigen::MatrixXd informationOf(const std::vector<SE3>& poses, std::span<const RelativePose> edges) {
  const auto n = static_cast<Eigen::Index>(6 * poses.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  for (const RelativePose& e : edges) {
    const RelativePoseLinear l =
        linearize(e, e.from == kWorld ? SE3() : poses[static_cast<std::size_t>(e.from)],
                  poses[static_cast<std::size_t>(e.to)]);
    Eigen::MatrixXd row = Eigen::MatrixXd::Zero(6, n);
    if (e.from != kWorld) row.middleCols<6>(6 * e.from) = l.by_from;
    row.middleCols<6>(6 * e.to) = l.by_to;
    information += row.transpose() * e.information * row;
  }
  return information;
}

Eigen::MatrixXd marginalOf(const Eigen::MatrixXd& information) {
  const Eigen::Index n = information.rows() - 6;
  const Matrix6d first = information.topLeftCorner<6, 6>();
  return information.bottomRightCorner(n, n) -
         information.bottomLeftCorner(n, 6) * first.ldlt().solve(information.topRightCorner(6, n));
}

Eigen::MatrixXd covarianceOf(const std::vector<SE3>& poses, std::span<const RelativePose> edges) {
  const Eigen::MatrixXd information = informationOf(poses, edges);
  const Eigen::Index n = information.rows() - 6;
  return information.bottomRightCorner(n, n).llt().solve(Eigen::MatrixXd::Identity(n, n));
}

Eigen::MatrixXd jointOf(const Eigen::MatrixXd& covariance, int a, int b) {
  const auto block = [&](int x, int y) { return covariance.block<6, 6>(6 * (x - 1), 6 * (y - 1)); };
  Eigen::MatrixXd both(12, 12);
  both << block(a, a), block(a, b), block(b, a), block(b, b);
  return both;
}

bool isPositive(const Eigen::MatrixXd& m, double tolerance) {
  const Eigen::MatrixXd raised = m + tolerance * Eigen::MatrixXd::Identity(m.rows(), m.cols());
  return raised.llt().info() == Eigen::Success;
}

std::vector<RelativePose> measurementsOf(const IncrementalSolver& solver) {
  std::vector<RelativePose> all;
  for (int k = 0; k < solver.measurements(); ++k) {
    const Measurement& m = solver.measurement(k);
    if (m.in_use) all.push_back({m.from, m.to, m.T_from_to, m.weight * m.root.transpose() * m.root});
  }
  return all;
}

}  // namespace fathom::slam

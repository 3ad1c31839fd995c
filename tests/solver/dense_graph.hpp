#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "recon/solver/incremental/incremental_solver.hpp"

// Normal equations of a small graph as one dense matrix.
namespace fathom::slam {

[[nodiscard]] Eigen::MatrixXd informationOf(const std::vector<SE3>& poses,
                                            std::span<const RelativePose> edges);

// Of all poses but the first, once that one has been eliminated, from informationOf().
[[nodiscard]] Eigen::MatrixXd marginalOf(const Eigen::MatrixXd& information);

// Covariance of every pose but the first, which is held, from the whole matrix.
[[nodiscard]] Eigen::MatrixXd covarianceOf(const std::vector<SE3>& poses,
                                           std::span<const RelativePose> edges);

// Of two poses together, from covarianceOf().
[[nodiscard]] Eigen::MatrixXd jointOf(const Eigen::MatrixXd& covariance, int a, int b);

// Whether a symmetric matrix has no eigenvalue below -`tolerance`.
[[nodiscard]] bool isPositive(const Eigen::MatrixXd& m, double tolerance);

// All that a solver has, its weights in the informations.
[[nodiscard]] std::vector<RelativePose> measurementsOf(const IncrementalSolver& solver);

}  // namespace fathom::slam

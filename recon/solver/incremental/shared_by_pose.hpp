#pragma once

#include <Eigen/Core>

#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {

// Effect of errors that many measurements share on the poses of a graph that takes them for independent: as
// considered parameters (Schmidt 1966), each moves all poses by the solution of the normal equations with its
// gradient. Updated in parts, as the factor is as large as the dive; a pose that is added meanwhile moves
// with the one before. Fixed memory.
class SharedByPose {
 public:
  static constexpr int kShared = 4;
  // A perturbation for one unit of each error.
  using Each = Eigen::Matrix<double, 6, kShared>;
  using Covariance = Eigen::Matrix<double, kShared, kShared>;
  using Errors = Eigen::Matrix<double, kShared, 1>;
  // Information of measurements about the errors, and that times the errors less what was removed.
  struct Evidence {
    Covariance information = Covariance::Zero();
    Errors sum = Errors::Zero();
  };

  explicit SharedByPose(int poses);

  // A new pose, known by another and by a measurement between them with
  // this error of its T_from_to (right perturbation).
  void hang(int pose, int from, const SE3& T_w_pose, const Each& error);
  // Updates all poses: begin(), add() with each measurement that has the
  // errors, then solve() until it returns true.
  void begin();
  void add(const IncrementalSolver& graph, int measurement, const Each& error);
  [[nodiscard]] bool solve(IncrementalSolver& graph);
  // Adds the information about the errors of a measurement that was added: its part of their normal equations
  // after the poses are marginalised (the Schur complement). `left`: errors that are still to be removed.
  void addEvidence(const IncrementalSolver& graph, int measurement, const Each& error, const Errors& left,
                   Evidence& evidence) const;

  // Of T_from_to, right perturbation, and its covariance for errors of that
  // covariance; `from` kWorld: of the pose itself.
  [[nodiscard]] Each moved(int from, int to, const SE3& T_w_to) const;
  [[nodiscard]] Matrix6d covariance(int from, int to, const SE3& T_w_to, const Covariance& errors) const;

  [[nodiscard]] std::size_t memoryBytes() const {
    return static_cast<std::size_t>(gradients_.size() + moved_.size()) * sizeof(double);
  }

 private:
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, kShared>;
  Columns gradients_, moved_;  // six rows for each pose: perturbations in the world
  int next_ = 0;               // column to be solved for
};

}  // namespace fathom::slam

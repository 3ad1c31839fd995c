#pragma once

#include <Eigen/Core>

#include "recon/slam/incremental_solver.hpp"

namespace fathom::slam {

// What errors that many measurements share do to the poses of a graph that takes each measurement's for its
// own: as considered parameters (Schmidt 1966), each moves all poses by the solution of the normal equations
// with what it pulls at them. Found anew in parts, for the factor is as large as the dive; a pose that comes
// meanwhile moves with the one before. Fixed memory.
class SharedByPose {
 public:
  static constexpr int kShared = 4;
  // Of each: a perturbation, by one unit of the error.
  using Each = Eigen::Matrix<double, 6, kShared>;
  using Covariance = Eigen::Matrix<double, kShared, kShared>;
  using Errors = Eigen::Matrix<double, kShared, 1>;
  // Of the errors, by measurements: information, and that times how far they are from what was removed.
  struct Evidence {
    Covariance information = Covariance::Zero();
    Errors sum = Errors::Zero();
  };

  explicit SharedByPose(int poses);

  // A pose that came is known by another and what was measured between them, whose T_from_to errs by `error`
  // (right perturbation).
  void hang(int pose, int from, const SE3& T_w_pose, const Each& error);
  // Errors pull anew: begin(), pull() by each measurement that has them, then solve() until it says true.
  void begin();
  void pull(const IncrementalSolver& graph, int measurement, const Each& error);
  [[nodiscard]] bool solve(IncrementalSolver& graph);
  // What a measurement that pulled tells of the errors beside all that holds its poses: its part of the
  // normal equations less what moving the poses takes up (the Schur complement). `left`: what is still to be
  // removed.
  void addEvidence(const IncrementalSolver& graph, int measurement, const Each& error, const Errors& left,
                   Evidence& evidence) const;

  // Of T_from_to, right perturbation, and its covariance for errors of that covariance; `from` kWorld: of the
  // pose itself.
  [[nodiscard]] Each moved(int from, int to, const SE3& T_w_to) const;
  [[nodiscard]] Matrix6d covariance(int from, int to, const SE3& T_w_to, const Covariance& errors) const;

  [[nodiscard]] std::size_t memoryBytes() const {
    return static_cast<std::size_t>(pulls_.size() + moved_.size()) * sizeof(double);
  }

 private:
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, kShared>;
  Columns pulls_, moved_;  // six rows for each pose: perturbations in the world
  int next_ = 0;           // column to be solved for
};

}  // namespace fathom::slam

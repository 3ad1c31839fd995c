#pragma once

#include <memory>
#include <vector>

#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/pose_graph.hpp"

namespace fathom::slam {

// Marginal covariances of a solved graph, by one factorisation.
class GraphCovariance {
 public:
  // `common_scale`: standard deviation of a scale that all poses of `scaled` share
  // (SensorNoise::visual_scale); about their mean, which fixes hold.
  explicit GraphCovariance(const PoseGraph& graph, double common_scale = 0,
                           const std::vector<int>& scaled = {});
  // Of the pose's right perturbation (rho, phi); and of T_a_b's.
  [[nodiscard]] Matrix6d of(int pose);
  [[nodiscard]] Matrix6d between(int a, int b);

 private:
  std::unique_ptr<IncrementalSolver> solver_;
  double common_scale_ = 0;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
};

}  // namespace fathom::slam

#include "recon/slam/graph_covariance.hpp"

#include <limits>
#include <stdexcept>

namespace fathom::slam {
namespace {

constexpr int kSpare = 16;                                        // room beyond what is known to come
constexpr int kMaxSettling = 50;                                  // steps until the factor is there
constexpr std::int64_t kBlocksPerLink = 40, kBlocksPerPose = 16;  // of a factor in a good order

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

// A covariance with that of the pose's way from a point, of which a common scale is uncertain.
Matrix6d widened(Matrix6d covariance, const SE3& pose, const Eigen::Vector3d& from, double scale) {
  const Eigen::Vector3d moved = scale * (pose.rotation().conjugate() * (pose.translation() - from));
  covariance.topLeftCorner<3, 3>() += moved * moved.transpose();
  return covariance;
}

}  // namespace

GraphCovariance::GraphCovariance(const PoseGraph& graph, double common_scale, const std::vector<int>& scaled)
    : common_scale_(common_scale) {
  for (const int pose : scaled)
    centre_ += graph.poses[at(pose)].translation() / static_cast<double>(scaled.size());
  IncrementalConfig config;
  config.max_poses = static_cast<int>(graph.poses.size()) + kSpare;
  config.max_measurements = static_cast<int>(graph.edges.size()) + kSpare;
  config.max_factor_blocks = kBlocksPerPose * config.max_poses + kBlocksPerLink * config.max_measurements;
  config.update_quota = 1;
  config.build_quota = config.urgent_quota = std::numeric_limits<std::int64_t>::max() / 4;
  solver_ = std::make_unique<IncrementalSolver>(config);
  for (const SE3& pose : graph.poses) (void)solver_->addPose(pose);
  for (const RelativePose& edge : graph.edges)
    if (solver_->addMeasurement(edge) != AddStatus::kOk)
      throw std::invalid_argument("covariance: a measurement of the graph is refused");
  StepReport report;
  for (int k = 0; k < kMaxSettling; ++k) {
    report = solver_->step();
    if (report.measurements_waiting == 0 && !report.waits_for_factor) return;
  }
}

Matrix6d GraphCovariance::of(int pose) {
  return widened(solver_->covariance(pose), solver_->pose(pose), centre_, common_scale_);
}

Matrix6d GraphCovariance::between(int a, int b) {
  return widened(solver_->relativeCovariance(a, b), solver_->pose(b), solver_->pose(a).translation(),
                 common_scale_);
}

}  // namespace fathom::slam

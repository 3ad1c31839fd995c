#include "recon/slam/shared_by_pose.hpp"

#include <algorithm>
#include <span>

namespace fathom::slam {

SharedByPose::SharedByPose(int poses)
    : rows_(6 * static_cast<std::ptrdiff_t>(poses)),
      pulls_(static_cast<std::size_t>(kShared * rows_)),
      moved_(pulls_.size()) {}

SharedByPose::Columns SharedByPose::of(const std::vector<double>& columns, int pose) const {
  return Columns(columns.data() + 6 * pose, Eigen::OuterStride<>(rows_));
}

void SharedByPose::hang(int pose, int from, const SE3& T_w_pose, const Each& error) {
  const Eigen::Matrix3d R = T_w_pose.matrix3();
  Each moved = of(moved_, from);
  for (int i = 0; i < kShared; ++i) {
    const Eigen::Vector3d turn = R * error.col(i).tail<3>();
    moved.col(i).head<3>() += R * error.col(i).head<3>() + T_w_pose.translation().cross(turn);
    moved.col(i).tail<3>() += turn;
  }
  Eigen::Map<Each, 0, Eigen::OuterStride<>>(moved_.data() + 6 * pose, Eigen::OuterStride<>(rows_)) = moved;
}

void SharedByPose::begin() {
  std::fill(pulls_.begin(), pulls_.end(), 0);
  next_ = 0;
}

void SharedByPose::pull(const IncrementalSolver& graph, int measurement, const Each& error) {
  const Measurement& m = graph.measurement(measurement);
  const Each pull = graph.pull(measurement) * error;
  for (int i = 0; i < kShared; ++i) {
    double* column = pulls_.data() + i * rows_;
    Eigen::Map<Vector6d>(column + 6 * m.to) += pull.col(i);
    if (m.from != kWorld) Eigen::Map<Vector6d>(column + 6 * m.from) -= pull.col(i);
  }
}

bool SharedByPose::solve(IncrementalSolver& graph) {
  const auto rows = static_cast<std::size_t>(rows_), column = static_cast<std::size_t>(next_) * rows;
  graph.solve(std::span(pulls_).subspan(column, rows), std::span(moved_).subspan(column, rows));
  next_ = (next_ + 1) % kShared;
  return next_ == 0;
}

Matrix6d SharedByPose::covariance(int from, int to, const SE3& T_w_to, const Covariance& errors) const {
  Each moved = of(moved_, to);
  if (from != kWorld) moved -= of(moved_, from);
  moved = (ownFrame(T_w_to) * moved).eval();
  return moved * errors * moved.transpose();
}

}  // namespace fathom::slam

#include "recon/solver/incremental/shared_by_pose.hpp"

#include <cmath>
#include <span>

namespace fathom::slam {

SharedByPose::SharedByPose(int poses)
    : gradients_(Columns::Zero(6 * poses, kShared)), moved_(Columns::Zero(6 * poses, kShared)) {}

void SharedByPose::hang(int pose, int from, const SE3& T_w_pose, const Each& error) {
  moved_.middleRows<6>(6 * pose) = moved_.middleRows<6>(6 * from) + ownFrame(T_w_pose.inverse()) * error;
}

void SharedByPose::begin() {
  gradients_.setZero();
  next_ = 0;
}

void SharedByPose::add(const IncrementalSolver& graph, int measurement, const Each& error) {
  const Measurement& m = graph.measurement(measurement);
  const Each gradient = graph.gradientPerError(measurement) * error;
  gradients_.middleRows<6>(6 * m.to) += gradient;
  if (m.from != kWorld) gradients_.middleRows<6>(6 * m.from) -= gradient;
}

bool SharedByPose::solve(IncrementalSolver& graph) {
  const auto rows = static_cast<std::size_t>(gradients_.rows());
  graph.solve(std::span(gradients_.col(next_).data(), rows), std::span(moved_.col(next_).data(), rows));
  next_ = (next_ + 1) % kShared;
  return next_ == 0;
}

void SharedByPose::addEvidence(const IncrementalSolver& graph, int measurement, const Each& error,
                               const Errors& left, Evidence& evidence) const {
  const Measurement& m = graph.measurement(measurement);
  const SE3 from = m.from == kWorld ? SE3() : graph.pose(m.from);
  const Vector6d off = -std::sqrt(m.weight) * m.root * plainError(m, from, graph.pose(m.to));
  const Matrix6d root = rootByPerturbation(m);
  const Each seen = root * error, open = seen - root * moved(m.from, m.to, graph.pose(m.to));
  evidence.information += seen.transpose() * open;
  evidence.sum += seen.transpose() * (off - open * left);
}

SharedByPose::Each SharedByPose::moved(int from, int to, const SE3& T_w_to) const {
  Each moved = moved_.middleRows<6>(6 * to);
  if (from != kWorld) moved -= moved_.middleRows<6>(6 * from);
  return ownFrame(T_w_to) * moved;
}

Matrix6d SharedByPose::covariance(int from, int to, const SE3& T_w_to, const Covariance& errors) const {
  const Each by = moved(from, to, T_w_to);
  return by * errors * by.transpose();
}

}  // namespace fathom::slam

#include "recon/solver/incremental/present_errors.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::slam {
namespace {

// Change of a measurement's error [half angle, shift over lever] from which it is linearised again.
constexpr double kRelinearize = 1e-3;

}  // namespace

PresentErrors::PresentErrors(const Measurements& measurements, std::span<const SE3> poses,
                             std::span<const std::uint8_t> held, int max_measurements, rt::Arena& arena)
    : measurements_(measurements), poses_(poses), fixed_(held) {
  const std::size_t edges = at(max_measurements);
  by_to_ = arena.allocateArray<Matrix6d>(edges);
  error_then_ = arena.allocateArray<Vector6d>(edges);
  pull_ = arena.allocateArray<PosePerturbation>(edges);
  is_taken_ = arena.allocateArray<std::uint8_t>(edges);
  is_moved_ = arena.allocateArray<std::uint8_t>(edges);
  chi2_of_ = arena.allocateArray<double>(edges);
  stamp_ = arena.allocateArray<int>(edges);
  gradient_ = arena.allocateArray<double>(kBlockSize * poses.size());
  dirty_ = arena.allocateArray<int>(poses.size());
  is_dirty_ = arena.allocateArray<std::uint8_t>(poses.size());
}

std::size_t PresentErrors::bytes(int max_poses, int max_measurements) {
  constexpr std::size_t kArrays = 10, kAlignment = alignof(Block);
  return at(max_poses) * (kBlockSize * sizeof(double) + sizeof(int) + sizeof(std::uint8_t)) +
         at(max_measurements) * (sizeof(Matrix6d) + 2 * sizeof(Vector6d) + 2 * sizeof(std::uint8_t) +
                                 sizeof(double) + sizeof(int)) +
         kArrays * kAlignment;
}

void PresentErrors::clear() {
  for (std::span<std::uint8_t>* s : {&is_taken_, &is_moved_, &is_dirty_})
    std::fill(s->begin(), s->end(), std::uint8_t{0});
  for (std::span<double>* s : {&chi2_of_, &gradient_}) std::fill(s->begin(), s->end(), 0.0);
  std::fill(stamp_.begin(), stamp_.end(), 0);
  dirty_count_ = evaluation_ = 0;
  chi2_ = 0;
}

bool PresentErrors::takeMoved(int measurement) {
  const bool moved = is_moved_[at(measurement)] != 0;
  is_moved_[at(measurement)] = 0;
  return moved;
}

void PresentErrors::take(int measurement) {
  is_taken_[at(measurement)] = 1;
  linearize(measurement);
}

void PresentErrors::drop(int measurement) {
  const Measurement& m = measurements_[measurement];
  is_taken_[at(measurement)] = is_moved_[at(measurement)] = 0;
  chi2_of_[at(measurement)] = 0;
  markDirty(m.from);
  markDirty(m.to);
}

void PresentErrors::renew(int measurement) {
  linearize(measurement);
  refreshGradient();
}

void PresentErrors::markDirty(int pose) {
  if (pose == kWorld || fixed_[at(pose)] || is_dirty_[at(pose)]) return;
  is_dirty_[at(pose)] = 1;
  dirty_[at(dirty_count_++)] = pose;
}

void PresentErrors::linearize(int k) {
  const Measurement& m = measurements_[k];
  WhitenedLinear linear;
  error_then_[at(k)] = linearizeWhitened(m, fromPose(m).inverse() * poses_[at(m.to)], m.weight, linear);
  by_to_[at(k)] = linear.by_to;
  noteError(k, error_then_[at(k)], linear.error);
}

// What follows from a measurement's error: chi2, and by_to^T of this moment times the weighted error, where
// by_to (pose_graph.hpp) is made of the rotation that the error is of.
void PresentErrors::noteError(int k, const Vector6d& plain, const Vector6d& whitened) {
  const Measurement& m = measurements_[k];
  chi2_of_[at(k)] = whitened.squaredNorm();
  const Vector6d force = std::sqrt(m.weight) * (m.root.transpose() * whitened);
  const Eigen::Vector3d v = plain.tail<3>();
  const double w = std::sqrt(std::max(0.0, 1 - v.squaredNorm()));
  Vector6d own;
  own.head<3>() = Eigen::Quaterniond(w, v.x(), v.y(), v.z()).conjugate()._transformVector(force.head<3>());
  own.tail<3>() = 0.5 * (w * force.tail<3>() - v.cross(force.tail<3>()));
  pull_[at(k)] = fromOwnFrame(poses_[at(m.to)], own);
  markDirty(m.from);
  markDirty(m.to);
}

void PresentErrors::evaluate(int k) {
  const Measurement& m = measurements_[k];
  const Vector6d error = plainError(m, fromPose(m), poses_[at(m.to)]);
  is_moved_[at(k)] = 1;
  const Vector6d change = error - error_then_[at(k)];
  if (change.tail<3>().norm() + change.head<3>().norm() / m.lever > kRelinearize) {
    linearize(k);
    return;
  }
  noteError(k, error, std::sqrt(m.weight) * (m.root * error));
}

void PresentErrors::follow(std::span<const int> moved) {
  ++evaluation_;
  for (const int pose : moved) {
    for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose)) {
      if (!has(k) || stamp_[at(k)] == evaluation_) continue;
      stamp_[at(k)] = evaluation_;
      evaluate(k);
    }
  }
  refreshGradient();
}

void PresentErrors::refreshGradient() {
  for (int i = 0; i < dirty_count_; ++i) {
    const int pose = dirty_[at(i)];
    is_dirty_[at(pose)] = 0;
    Eigen::Map<Vector6d> g(&gradient_[at(kBlockSize * pose)]);
    g.setZero();
    for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose)) {
      if (!has(k)) continue;
      if (measurements_[k].to == pose)
        g += pull_[at(k)];
      else
        g -= pull_[at(k)];
    }
  }
  dirty_count_ = 0;
  chi2_ = 0;
  for (int k = 0; k < measurements_.size(); ++k) chi2_ += chi2_of_[at(k)];
}

double PresentErrors::curvature(std::span<const double> direction) const {
  double sum = 0;
  for (int k = 0; k < measurements_.size(); ++k) {
    if (!has(k)) continue;
    const Measurement& m = measurements_[k];
    const Eigen::Map<const PosePerturbation> to(&direction[at(kBlockSize * m.to)]);
    PosePerturbation difference = to;
    if (m.from != kWorld)
      difference -= Eigen::Map<const PosePerturbation>(&direction[at(kBlockSize * m.from)]);
    if (difference.isZero(0)) continue;
    sum += (by_to_[at(k)] * toOwnFrame(poses_[at(m.to)], difference)).squaredNorm();
  }
  return sum;
}

}  // namespace fathom::slam

#include "recon/slam/measurements.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "recon/geometry/cross_matrix.hpp"
#include "recon/geometry/symmetric_eigen.hpp"

namespace fathom::slam {
namespace {

// R with R^T R = information. Cholesky's is ten times as quick; without full rank there is none.
Matrix6d rootOf(const Matrix6d& information) {
  const Eigen::LLT<Matrix6d> cholesky(information);
  if (cholesky.info() == Eigen::Success) return cholesky.matrixU();
  const SymmetricEigen<6> eigen = symmetricEigen(information);
  return eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
}

}  // namespace

Measurements::Measurements(int poses, int capacity, rt::Arena& arena)
    : all_(arena.allocateArray<Measurement>(static_cast<std::size_t>(capacity))),
      first_(arena.allocateArray<int>(static_cast<std::size_t>(poses))),
      free_(arena.allocateArray<int>(static_cast<std::size_t>(capacity))) {
  for (int& k : first_) k = -1;
}

std::size_t Measurements::bytes(int poses, int capacity) {
  return static_cast<std::size_t>(capacity) * (sizeof(Measurement) + sizeof(int)) +
         static_cast<std::size_t>(poses) * sizeof(int) + 3 * alignof(Measurement);
}

AddStatus Measurements::add(const RelativePose& edge, int poses, int* index, bool composed) {
  if (edge.from < kWorld || edge.to < 0 || edge.from >= poses || edge.to >= poses)
    return AddStatus::kNoSuchPose;
  if (edge.from == edge.to || !edge.information.allFinite() || !edge.T_from_to.translation().allFinite() ||
      !edge.T_from_to.rotation().coeffs().allFinite() ||
      (edge.information - edge.information.transpose()).norm() > 1e-9 * edge.information.norm())
    return AddStatus::kBadMeasurement;
  if (!isPositive(edge.information)) return AddStatus::kBadMeasurement;
  if (free_count_ == 0 && static_cast<std::size_t>(size_) >= all_.size()) return AddStatus::kFull;
  const int k = free_count_ > 0 ? free_[static_cast<std::size_t>(--free_count_)] : size_++;
  Measurement& m = all_[static_cast<std::size_t>(k)];
  m.in_use = true;
  m.composed = composed;
  m.born = births_++;
  m.from = edge.from;
  m.to = edge.to;
  m.T_from_to = edge.T_from_to;
  m.root = rootOf(edge.information);
  m.weight = 1;
  // Of the translation that was measured, and of the information: for a measurement between poses at one
  // place.
  const double turn = edge.information.diagonal().tail<3>().sum(),
               shift = edge.information.diagonal().head<3>().sum();
  m.lever = std::hypot(edge.T_from_to.translation().norm(), shift > 0 ? std::sqrt(turn / shift) : 1);
  const auto chain = [&](int pose, int end) {
    m.next[end] = first_[static_cast<std::size_t>(pose)];
    first_[static_cast<std::size_t>(pose)] = k;
  };
  if (m.from != kWorld) chain(m.from, 0);
  chain(m.to, 1);
  if (index != nullptr) *index = k;
  return AddStatus::kOk;
}

void Measurements::unlink(int pose, int k) {
  int* link = &first_[static_cast<std::size_t>(pose)];
  while (*link != k) {
    Measurement& m = all_[static_cast<std::size_t>(*link)];
    link = &m.next[m.to == pose ? 1 : 0];
  }
  *link = next(k, pose);
}

void Measurements::remove(int k) {
  Measurement& m = all_[static_cast<std::size_t>(k)];
  if (m.from != kWorld) unlink(m.from, k);
  unlink(m.to, k);
  m.in_use = false;
  free_[static_cast<std::size_t>(free_count_++)] = k;
}

Vector6d toOwnFrame(const SE3& pose, const Perturbation& x) {
  const Eigen::Matrix3d back = pose.matrix3().transpose();
  Vector6d y;
  y.head<3>() = back * (x.head<3>() + x.tail<3>().cross(pose.translation()));
  y.tail<3>() = back * x.tail<3>();
  return y;
}

Perturbation fromOwnFrame(const SE3& pose, const Vector6d& force) {
  const Eigen::Matrix3d r = pose.matrix3();
  Perturbation x;
  x.head<3>() = r * force.head<3>();
  x.tail<3>() = r * force.tail<3>() + pose.translation().cross(x.head<3>());
  return x;
}

Matrix6d ownFrame(const SE3& pose) {
  const Eigen::Matrix3d back = pose.matrix3().transpose();
  const Eigen::Vector3d t = pose.translation();
  Matrix6d a = Matrix6d::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = back;
  a.topRightCorner<3, 3>() = -back * crossMatrix(t);
  return a;
}

SE3 perturbedInWorld(const SE3& pose, const Perturbation& x) {
  return perturbed(SE3(), x) * pose;
}

Vector6d plainError(const Measurement& m, const SE3& T_w_from, const SE3& T_w_to) {
  const Eigen::Quaterniond back = T_w_from.rotation().conjugate(),
                           measured = m.T_from_to.rotation().conjugate();
  const Eigen::Quaterniond q = measured * (back * T_w_to.rotation());
  Vector6d error;
  error.head<3>() = measured._transformVector(
      back._transformVector(T_w_to.translation() - T_w_from.translation()) - m.T_from_to.translation());
  error.tail<3>() = (q.w() < 0 ? -1.0 : 1.0) * q.vec();
  return error;
}

Matrix6d rootByPerturbation(const Measurement& m) {
  Matrix6d root = std::sqrt(m.weight) * m.root;
  root.rightCols<3>() *= 0.5;
  return root;
}

Vector6d linearizeWhitened(const Measurement& m, const SE3& T_from_to, double weight,
                           WhitenedLinear& result) {
  const RelativePoseLinear l = linearize({m.from, m.to, m.T_from_to, {}}, SE3(), T_from_to);
  const double scale = std::sqrt(weight);
  result.by_to = scale * (m.root * l.by_to);
  result.error = scale * (m.root * l.error);
  return l.error;
}

Block worldDerivative(const Measurement& m, const InFactor& then) {
  WhitenedLinear l;
  linearizeWhitened(m, then.T_w_from.inverse() * then.T_w_to, then.weight, l);
  Block b;
  Eigen::Map<Matrix6d>(b.v).noalias() = l.by_to * ownFrame(then.T_w_to);
  return b;
}

}  // namespace fathom::slam

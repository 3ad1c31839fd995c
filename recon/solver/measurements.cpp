#include "recon/solver/measurements.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "realtime/base/numbers/portable_math.hpp"
#include "recon/geometry/state_values.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::slam {
namespace {

// R with R^T R = information: Cholesky's (ten times as quick), or without full rank the symmetric root.
Matrix6d rootOf(const Matrix6d& information) {
  const Eigen::LLT<Matrix6d> cholesky(information);
  if (cholesky.info() == Eigen::Success) return cholesky.matrixU();
  const SymmetricEigen<6> eigen = symmetricEigen(information);
  return eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
}

void exchangeMeasurement(auto& archive, auto& m) {
  archive(m.in_use);
  if (!m.in_use) return;
  archive(m.from, m.to, m.T_from_to, m.weight, m.lever, m.composed, m.born);
  exchangeSparse(archive, m.root);
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
  if (edge.from == edge.to || !edge.information.allFinite() || !isFinite(edge.T_from_to) ||
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
  // By the measured translation and, for poses at one place, by the information.
  const double turn = edge.information.diagonal().tail<3>().sum(),
               shift = edge.information.diagonal().head<3>().sum();
  m.lever = hypotenuse(edge.T_from_to.translation().norm(), shift > 0 ? std::sqrt(turn / shift) : 1);
  link(k);
  if (index != nullptr) *index = k;
  return AddStatus::kOk;
}

// Puts a measurement first in the lists of its poses.
void Measurements::link(int k) {
  Measurement& m = all_[static_cast<std::size_t>(k)];
  const auto chain = [&](int pose, int end) {
    m.next[end] = first_[static_cast<std::size_t>(pose)];
    first_[static_cast<std::size_t>(pose)] = k;
  };
  if (m.from != kWorld) chain(m.from, 0);
  chain(m.to, 1);
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

template <typename Archive, typename Self>
void Measurements::exchange(Archive& archive, Self& self) {
  archive(self.size_, self.free_count_, self.births_);
  archive.require(self.size_ >= 0 && static_cast<std::size_t>(self.size_) <= self.all_.size() &&
                      self.free_count_ >= 0 && self.free_count_ <= self.size_,
                  "more measurements than there is room for");
  if constexpr (Archive::kLoading)
    if (!archive.ok()) return;
  archive.elements(self.free_.data(), static_cast<std::size_t>(self.free_count_));
  for (auto& m : self.all_.first(static_cast<std::size_t>(self.size_))) exchangeMeasurement(archive, m);
}

void Measurements::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool Measurements::load(rt::StateReader& reader, int poses) {
  exchange(reader, *this);
  if (!reader.ok()) return false;
  std::vector<int> in_use;
  for (int k = 0; k < size_; ++k) {
    const Measurement& m = (*this)[k];
    if (!m.in_use) continue;
    const bool good = m.from >= kWorld && m.from < poses && m.to >= 0 && m.to < poses && m.from != m.to &&
                      isFinite(m.T_from_to) && m.root.allFinite() && m.weight >= 0 &&
                      std::isfinite(m.weight) && m.lever > 0 && std::isfinite(m.lever) && m.born >= 0 &&
                      m.born < births_;
    if (!good) {
      reader.fail("a measurement that cannot be");
      return false;
    }
    in_use.push_back(k);
  }
  const std::span<const int> free(free_.data(), static_cast<std::size_t>(free_count_));
  if (in_use.size() + free.size() != static_cast<std::size_t>(size_) ||
      !areFreePlaces(free, size_, [&](int k) { return !(*this)[k].in_use; })) {
    reader.fail("measurements' places contradict each other");
    return false;
  }
  // The lists of poses have the newest first.
  std::sort(in_use.begin(), in_use.end(), [&](int a, int b) {
    return std::make_pair((*this)[a].born, a) < std::make_pair((*this)[b].born, b);
  });
  std::fill(first_.begin(), first_.end(), -1);
  for (const int k : in_use) link(k);
  return true;
}

Vector6d toOwnFrame(const SE3& pose, const PosePerturbation& x) {
  const Eigen::Matrix3d back = pose.matrix3().transpose();
  Vector6d y;
  y.head<3>() = back * (x.head<3>() + x.tail<3>().cross(pose.translation()));
  y.tail<3>() = back * x.tail<3>();
  return y;
}

PosePerturbation fromOwnFrame(const SE3& pose, const Vector6d& force) {
  const Eigen::Matrix3d r = pose.matrix3();
  PosePerturbation x;
  x.head<3>() = r * force.head<3>();
  x.tail<3>() = r * force.tail<3>() + pose.translation().cross(x.head<3>());
  return x;
}

Matrix6d ownFrame(const SE3& pose) {
  const Eigen::Matrix3d back = pose.matrix3().transpose();
  const Eigen::Vector3d& t = pose.translation();
  Matrix6d a = Matrix6d::Zero();
  a.topLeftCorner<3, 3>() = a.bottomRightCorner<3, 3>() = back;
  a.topRightCorner<3, 3>() = -back * crossMatrix(t);
  return a;
}

SE3 perturbedInWorld(const SE3& pose, const PosePerturbation& x) {
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

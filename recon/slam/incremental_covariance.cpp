#include <Eigen/Core>
#include <algorithm>

#include "recon/slam/incremental_solver.hpp"

// Covariances that the factor gives.
namespace fathom::slam {
namespace {

constexpr double kUnknown = 1 / GrowingFactor::kLeastInformation;  // variance of what is not yet known

}  // namespace

Matrix6d IncrementalSolver::covariance(int i) {
  if (held_[at(i)]) return Matrix6d::Zero();
  if (!active().factor.has(i)) return kUnknown * Matrix6d::Identity();
  Matrix6d world;
  active().factor.covariance(i, -1, world.data());
  const Matrix6d own = ownFrame(pose(i));
  return own * world * own.transpose();
}

Matrix6d IncrementalSolver::relativeCovariance(int a, int b) {
  Matrix6d world = Matrix6d::Zero();  // of the difference of their perturbations
  if (a == b) return world;
  if (!active().factor.has(a) || !active().factor.has(b)) return kUnknown * Matrix6d::Identity();
  if (held_[at(a)] || held_[at(b)]) {
    active().factor.covariance(held_[at(a)] ? b : a, -1, world.data());
  } else {
    Eigen::Matrix<double, 12, 12> both;
    active().factor.covariance(a, b, both.data());
    world = both.topLeftCorner<6, 6>() + both.bottomRightCorner<6, 6>() - both.topRightCorner<6, 6>() -
            both.bottomLeftCorner<6, 6>();
  }
  const Matrix6d own = ownFrame(pose(b));
  return own * world * own.transpose();
}

Matrix6d IncrementalSolver::pull(int measurement) const {
  const Measurement& m = measurements_[measurement];
  const Block b = worldDerivative(m, {errors_.fromPose(m), pose(m.to), m.weight});
  return Eigen::Map<const Matrix6d>(b.v).transpose() * rootByPerturbation(m);
}

void IncrementalSolver::solve(std::span<const double> pulls, std::span<double> moved) {
  (void)active().factor.solve(pulls.data(), solved_.data(), 0);
  for (int i = 0; i < poses_count_; ++i)
    if (active().factor.has(i))
      std::copy_n(&solved_[at(kBlockSize * i)], kBlockSize, &moved[at(kBlockSize * i)]);
}

}  // namespace fathom::slam

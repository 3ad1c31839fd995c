#include "recon/solver/batch/graph_covariance.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <stdexcept>

#include "recon/solver/incremental/growing_factor.hpp"
#include "recon/solver/measurements.hpp"

namespace fathom::slam {

// Perturbations are those of measurements.hpp, about the middle of the graph:
// an edge's error moves with the difference of its poses', so every edge adds
// one square to two diagonal blocks and takes it from those beside.
GraphCovariance::GraphCovariance(const PoseGraph& graph, double common_scale, const std::vector<int>& scaled,
                                 const std::vector<SharedByEdge>& shared, const Errors& corrected)
    : poses_(graph.poses),
      common_scale_(common_scale),
      moved_(Eigen::MatrixXd::Zero(6 * static_cast<Eigen::Index>(graph.poses.size()), 1 + kShared)),
      shared_(corrected) {
  const int poses = static_cast<int>(poses_.size());
  for (const int pose : scaled)
    centre_ += poses_[at(pose)].translation() / static_cast<double>(scaled.size());
  for (const SE3& pose : poses_) middle_ += pose.translation() / static_cast<double>(poses);
  std::vector<BlockCholesky::Pair> pairs;
  for (const RelativePose& e : graph.edges) {
    if (e.from < 0 || e.to < 0 || e.from >= poses || e.to >= poses || e.from == e.to)
      throw std::invalid_argument("covariance: an edge of the graph names a pose that is not there");
    if (e.from > 0 && e.to > 0) pairs.push_back({e.from - 1, e.to - 1});
  }
  if (poses < 2) return;
  factor_ = std::make_unique<BlockCholesky>(poses - 1, 6, pairs, BlockCholesky::Order::kShortPaths);
  for (int k = 0; k < poses - 1; ++k)
    factor_->addDiagonal6(k, GrowingFactor::kLeastInformation * Matrix6d::Identity());
  std::vector<bool> shares(poses_.size(), false);
  for (const int pose : scaled) shares[at(pose)] = true;
  std::vector<const ByShared*> shared_by(graph.edges.size(), nullptr);
  for (const SharedByEdge& s : shared) shared_by.at(s.edge) = &s.error;
  OfShared normal;
  std::size_t pair = 0;
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    const RelativePose& e = graph.edges[k];
    const SE3 &from = poses_[at(e.from)], &to = poses_[at(e.to)];
    const RelativePoseLinear linear = linearize(e, from, to);
    normal.chi2 += linear.error.dot(e.information * linear.error);
    const Matrix6d by_to = linear.by_to * ownFrame(aboutMiddle(to));
    const Matrix6d square = by_to.transpose() * e.information * by_to;
    for (const int end : {e.from, e.to})
      if (end > 0) factor_->addDiagonal6(end - 1, square);
    if (e.from > 0 && e.to > 0) factor_->addPair6(pair++, -square);
    Moved off = Moved::Zero();
    if (shares[at(e.from)] && shares[at(e.to)])
      off.col(0).tail<3>() = common_scale * e.T_from_to.log().tail<3>();
    if (shared_by[k] != nullptr) off.rightCols<kShared>() = *shared_by[k];
    if (off.isZero(0)) continue;
    off.bottomRows<3>() *= 0.5;  // the error has half angles
    const Moved weighted = e.information * off;
    const auto by_shared = weighted.rightCols<kShared>();
    normal.square += by_shared.transpose() * off.rightCols<kShared>();
    normal.pull += by_shared.transpose() * linear.error;
    const Moved pull = by_to.transpose() * weighted;
    moved_.middleRows<6>(6 * e.to) += pull;
    moved_.middleRows<6>(6 * e.from) -= pull;
  }
  if (!factor_->factorize()) throw std::runtime_error("covariance: the graph's information is not positive");
  moved_.topRows<6>().setZero();
  if (moved_.isZero(0)) return;
  const Eigen::MatrixXd pulls = moved_;
  moved_.bottomRows(6 * (poses - 1)) = factor_->solve(pulls.bottomRows(6 * (poses - 1)));
  normal.redundancy = std::max(6.0 * (static_cast<double>(graph.edges.size()) - poses + 1), 6.0);
  estimate(normal, pulls.rightCols<kShared>());
}

// By the Schur complement of the poses, which are at their minimum. What edges have not been corrected for
// yet counts as open. Edges that contradict each other even with the most likely errors say as much less
// (variance of unit weight).
void GraphCovariance::estimate(const OfShared& edges, const Eigen::MatrixXd& pulls) {
  constexpr int kRounds = 3;
  using Square = Eigen::Matrix<double, kShared, kShared>;
  const Square square = edges.square - pulls.transpose() * moved_.rightCols<kShared>();
  Square covariance;
  Errors all;
  double share = 1;
  for (int round = 0; round < kRounds; ++round) {
    covariance = (Square::Identity() + share * square).llt().solve(Square::Identity());
    all = -(covariance * (shared_ + share * edges.pull));
    const double left = edges.chi2 + 2 * edges.pull.dot(all) + all.dot(square * all);
    share = 1 / std::max(left / edges.redundancy, 1.0);
  }
  const Eigen::Matrix<double, kEstimated, 1> more = all.tail<kEstimated>();
  shared_.head<kShared - kEstimated>().setZero();
  shared_.tail<kEstimated>() += more;
  const Eigen::Matrix<double, kEstimated, kEstimated> open =
      covariance.bottomRightCorner<kEstimated, kEstimated>() + more * more.transpose();
  moved_.rightCols<kEstimated>() *= Eigen::Matrix<double, kEstimated, kEstimated>(open.llt().matrixL());
}

GraphCovariance::TreePath GraphCovariance::pathOf(int pose) const {
  return pose == 0 ? TreePath() : factor_->pathOf(pose - 1, Matrix6d::Identity());
}

GraphCovariance::TreePath GraphCovariance::placePathOf(int pose) const {
  if (pose == 0) return {};
  const Matrix6d own = ownFrame(aboutMiddle(poses_[at(pose)]));
  const Eigen::Matrix<double, 3, 6> place = poses_[at(pose)].matrix3() * own.topRows<3>();
  return factor_->pathOf(pose - 1, place.topRows<2>().transpose());
}

Matrix6d GraphCovariance::widened(Matrix6d covariance, int pose, const Eigen::Vector3d& from,
                                  const Moved& moved) const {
  const SE3& T = poses_[at(pose)];
  const Eigen::Vector3d by_scale = common_scale_ * (T.rotation().conjugate() * (T.translation() - from));
  covariance.topLeftCorner<3, 3>() += by_scale * by_scale.transpose();
  const Moved own = ownFrame(aboutMiddle(T)) * moved;
  return covariance + own * own.transpose();
}

Matrix6d GraphCovariance::of(int pose, const TreePath& path) const {
  return pose == 0 ? Matrix6d::Zero()
                   : widened(between({}, path, poses_[at(pose)]), pose, centre_, movedOf(pose));
}

Matrix6d GraphCovariance::between(int a, const TreePath& path_a, int b, const TreePath& path_b) const {
  if (a == b) return Matrix6d::Zero();
  return widened(between(path_a, path_b, poses_[at(b)]), b, poses_[at(a)].translation(),
                 movedOf(b) - movedOf(a));
}

Matrix6d GraphCovariance::between(const TreePath& path_a, const TreePath& path_b, const SE3& T_w_b) const {
  const Matrix6d own = ownFrame(aboutMiddle(T_w_b));
  return own * BlockCholesky::squaredDifference(path_a, path_b) * own.transpose();
}

const GraphCovariance::TreePath& TreePathCache::of(int pose) {
  constexpr std::size_t kAtLeast = 2;  // a caller has two
  if (const auto found = find_.find(pose); found != find_.end()) {
    kept_.splice(kept_.begin(), kept_, found->second);
    return kept_.front().path;
  }
  kept_.push_front({pose, (graph_.*make_)(pose)});
  find_[pose] = kept_.begin();
  used_ += kept_.front().path.bytes();
  while (used_ > bytes_ && kept_.size() > kAtLeast) {
    used_ -= kept_.back().path.bytes();
    find_.erase(kept_.back().pose);
    kept_.pop_back();
  }
  return kept_.front().path;
}

}  // namespace fathom::slam

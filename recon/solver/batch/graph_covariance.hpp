#pragma once

#include <cstddef>
#include <list>
#include <memory>
#include <unordered_map>
#include <vector>

#include "recon/solver/batch/block_cholesky.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// Marginal covariances of a solved graph, by one factorisation of its normal equations (BlockCholesky). Pose
// 0 is held. Any number of threads may ask at once.
//
// A relative covariance costs two paths through the factor (BlockCholesky::TreePath) and a product of them;
// for many pairs, paths are kept (TreePathCache) and only the products are paid for.
class GraphCovariance {
 public:
  using TreePath = BlockCholesky::TreePath;

  // Effect on one edge of errors that many edges share, independent of each other and of variance 1: a column
  // each, the right perturbation (rho, phi) of its T_from_to [m], [rad]. The last ones turn edges: these are
  // estimated together with the poses.
  static constexpr int kShared = 8, kEstimated = 4;
  using ByShared = Eigen::Matrix<double, 6, kShared>;
  using Errors = Eigen::Matrix<double, kShared, 1>;
  struct SharedByEdge {
    std::size_t edge = 0;
    ByShared error;
  };

  // `common_scale`: standard deviation of an error of scale that all paths, and one that all turns between
  // poses of `scaled` share (SensorNoise::visual_scale): of paths about the middle of these poses, which
  // fixes hold, of turns as far as the graph yields to it. `shared`: errors that edges have in common
  // otherwise; of these, `corrected` has been taken out of the edges. The graph's weights contain neither: as
  // considered parameters (Schmidt 1966) they inflate covariances, those that are estimated by their
  // estimate's. Throws std::invalid_argument for an edge to a pose that is not there, and std::runtime_error
  // when there is no memory for the factor.
  explicit GraphCovariance(const PoseGraph& graph, double common_scale = 0,
                           const std::vector<int>& scaled = {}, const std::vector<SharedByEdge>& shared = {},
                           const Errors& corrected = Errors::Zero());
  // The shared errors, most likely together with the poses (Gauss-Newton, one step from `corrected`); zero
  // for those that are not estimated. Edges that contradict each other beyond their covariances count for as
  // much less against what is known of these errors beforehand.
  [[nodiscard]] const Errors& shared() const { return shared_; }
  // The path of a pose's perturbation in the world.
  [[nodiscard]] TreePath pathOf(int pose) const;
  // Of the pose's right perturbation (rho, phi); and of T_a_b's. With paths where the caller has them.
  [[nodiscard]] Matrix6d of(int pose) const { return of(pose, pathOf(pose)); }
  [[nodiscard]] Matrix6d of(int pose, const TreePath& path) const;
  [[nodiscard]] Matrix6d between(int a, int b) const { return between(a, pathOf(a), b, pathOf(b)); }
  [[nodiscard]] Matrix6d between(int a, const TreePath& path_a, int b, const TreePath& path_b) const;
  // The latter of two frames fixed to the poses of the given paths, without the common scale.
  [[nodiscard]] Matrix6d between(const TreePath& path_a, const TreePath& path_b, const SE3& T_w_b) const;
  // The path of a pose's place (north, east), two columns: a third of the work. And the covariance of the
  // separation of two places [m^2].
  [[nodiscard]] TreePath placePathOf(int pose) const;
  [[nodiscard]] static Eigen::Matrix2d separation(const TreePath& place_a, const TreePath& place_b) {
    return BlockCholesky::squaredDifference(place_a, place_b);
  }

  [[nodiscard]] std::size_t memoryBytes() const { return factor_->memoryBytes(); }

 private:
  [[nodiscard]] SE3 aboutMiddle(const SE3& T_w_pose) const {
    return {T_w_pose.rotation(), T_w_pose.translation() - middle_};
  }
  // Of turns first, then what edges share.
  using Moved = Eigen::Matrix<double, 6, 1 + kShared>;
  // Normal equations of the shared errors by edges, and chi-square of these.
  struct OfShared {
    Eigen::Matrix<double, kShared, kShared> square = Eigen::Matrix<double, kShared, kShared>::Zero();
    Errors pull = Errors::Zero();
    double chi2 = 0, redundancy = 0;
  };
  void estimate(const OfShared& edges, const Eigen::MatrixXd& pulls);
  [[nodiscard]] Moved movedOf(int pose) const { return moved_.middleRows<6>(6 * pose); }
  // A covariance, inflated by the common scale of the path from a point, and by what moves the pose.
  [[nodiscard]] Matrix6d widened(Matrix6d covariance, int pose, const Eigen::Vector3d& from,
                                 const Moved& moved) const;

  std::vector<SE3> poses_;
  std::unique_ptr<BlockCholesky> factor_;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();  // of the graph: perturbations turn about it
  double common_scale_ = 0;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  Eigen::MatrixXd moved_;  // what a standard deviation moves each pose by: Moved, row by row of poses
  Errors shared_;
};

// Paths by pose, those used last, in bounded memory. For one thread.
class TreePathCache {
 public:
  using Make = GraphCovariance::TreePath (GraphCovariance::*)(int) const;
  TreePathCache(const GraphCovariance& graph, Make make, std::size_t bytes)
      : graph_(graph), make_(make), bytes_(bytes) {}

  // Valid until the call after the next one.
  const GraphCovariance::TreePath& of(int pose);

 private:
  struct Kept {
    int pose;
    GraphCovariance::TreePath path;
  };
  const GraphCovariance& graph_;
  Make make_;
  std::size_t bytes_, used_ = 0;
  std::list<Kept> kept_;  // used last first
  std::unordered_map<int, std::list<Kept>::iterator> find_;
};

}  // namespace fathom::slam

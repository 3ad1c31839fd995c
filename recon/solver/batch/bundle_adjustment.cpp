#include "recon/solver/batch/bundle_adjustment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <memory>
#include <span>

#include "realtime/base/numbers/union_find.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/solver/batch/block_cholesky.hpp"
#include "recon/solver/block_kernels.hpp"

namespace fathom::slam {
namespace {

using Matrix63 = Eigen::Matrix<double, 6, 3>;
using Matrix43 = Eigen::Matrix<double, 4, 3>;
using Matrix46 = Eigen::Matrix<double, 4, 6>;

constexpr std::size_t kPointBlock = 2048;  // points that are marginalised in one parallel loop
constexpr double kNearestPoint_m = 1e-3;

// Derivative of a point's pixel by the point in the camera's frame.
Eigen::Matrix<double, 2, 3> derivative(const Camera& camera, const Eigen::Vector3d& p) {
  const Eigen::Vector2d n = p.head<2>() / p.z();
  Eigen::Matrix<double, 2, 3> by_point;
  by_point << 1 / p.z(), 0, -n.x() / p.z(), 0, 1 / p.z(), -n.y() / p.z();
  return camera.pixelJacobian(n) * by_point;
}

// Residual of one sighting, seen less projected [px]: the left pixel, then the right pixel less the left one.
struct Residual {
  Eigen::Vector4d error;
  Matrix43 by_point_in_camera;
};

bool residualOf(const StereoRig& rig, const Bundle::Sighting& seen, const Eigen::Vector3d& p, Residual& out) {
  const Eigen::Vector3d q = rig.T_right_left * p;
  if (p.z() < kNearestPoint_m || q.z() < kNearestPoint_m) return false;
  const Eigen::Vector2d left = rig.left.project(p), right = rig.right.project(q);
  out.error.head<2>() = seen.left.cast<double>() - left;
  out.error.tail<2>() = (seen.right - seen.left).cast<double>() - (right - left);
  const auto by_left = derivative(rig.left, p);
  out.by_point_in_camera.topRows<2>() = -by_left;
  out.by_point_in_camera.bottomRows<2>() = by_left - derivative(rig.right, q) * rig.T_right_left.matrix3();
  return true;
}

// Schur complement of one point: a quadratic cost in the poses of the views that see it.
struct Marginal {
  std::vector<Matrix6d> diagonal, pairs;  // blocks of each view; of views i < j, row i
  std::vector<Vector6d> gradient;
  double cost = 0;
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();  // weighted: left pixels, and right less left
  double weight = 0;                                  // of all sightings
  bool good = false;
};

class Adjuster {
 public:
  Adjuster(Bundle& bundle, const BundleConfig& config, const ForEach& for_each)
      : bundle_(bundle),
        config_(config),
        for_each_(for_each),
        sigma_left_(config.place),
        sigma_match_(config.match) {
    const std::size_t points = bundle.first.size() - 1;
    points_.resize(points);
    for (std::size_t k = 0; k < points; ++k) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      double count = 0;
      for (const Bundle::Sighting& s : sightingsOf(k)) {
        Eigen::Vector3d p;
        double gap = 0;
        if (!triangulatePixels(bundle.rig, s.left.cast<double>(), s.right.cast<double>(), p, gap)) continue;
        sum += poseOf(s) * p;
        ++count;
      }
      points_[k] = count > 0 ? Eigen::Vector3d(sum / count) : sum;
    }
    buildStructure();
  }

  BundleResult run() {
    BundleResult out;
    out.points = points_.size();
    out.sightings = bundle_.sightings.size();
    constexpr int kSettling = 3;  // the estimate of the noise is kept after this step, counted from 0
    double damping = 0;
    double cost = assemble();
    out.place_before = sigma_left_found_;
    for (int step = 0; step < config_.steps; ++step) {
      out.steps = step + 1;
      if (step <= kSettling) {
        sigma_left_ = std::max(sigma_left_found_, kLeastNoise);
        sigma_match_ = std::max(sigma_match_found_, kLeastNoise);
        cost = assemble();
      }
      if (!system_->factorize(damping)) {
        damping = std::max(10 * damping, kFirstDamping);
        continue;
      }
      const Eigen::VectorXd delta = system_->solve(-gradient_);
      const std::vector<SE3> poses = bundle_.graph.poses;
      const std::vector<Eigen::Vector3d> points = points_;
      for (std::size_t i = 0; i < poses.size(); ++i)
        if (of_pose_[i] >= 0)
          bundle_.graph.poses[i] = poses[i] * SE3::exp(Vector6d(delta.segment<6>(6 * of_pose_[i])));
      const double new_cost = assemble();
      if (new_cost > cost) {
        bundle_.graph.poses = poses;
        points_ = points;
        damping = std::max(10 * damping, kFirstDamping);
        cost = assemble();
        if (damping > kMostDamping) break;
        continue;
      }
      const bool small_decrease = cost - new_cost < kLeastDecrease * cost;
      cost = new_cost;
      damping = damping > kFirstDamping ? damping / 10 : 0;
      if (small_decrease && step > kSettling) {
        out.converged = true;
        break;
      }
    }
    out.place_after = sigma_left_found_;
    out.place = sigma_left_;
    out.match = sigma_match_;
    return out;
  }

 private:
  static constexpr double kLeastNoise = 0.02;  // floor of the noise's estimate [px]
  static constexpr double kFirstDamping = 1e-6, kMostDamping = 1e3;
  static constexpr double kLeastDecrease = 1e-4;  // of the cost, relative

  [[nodiscard]] std::span<const Bundle::Sighting> sightingsOf(std::size_t point) const {
    return {bundle_.sightings.data() + bundle_.first[point], bundle_.first[point + 1] - bundle_.first[point]};
  }
  [[nodiscard]] int nodeOf(const Bundle::Sighting& s) const { return bundle_.nodes[s.view]; }
  [[nodiscard]] const SE3& poseOf(const Bundle::Sighting& s) const {
    return bundle_.graph.poses[at(nodeOf(s))];
  }

  // Finds the poses that are solved for, and the pairs of them that share an edge or a point.
  void buildStructure() {
    const PoseGraph& graph = bundle_.graph;
    UnionFind parts(graph.poses.size());
    std::vector<BlockCholesky::Pair> pairs;
    const auto connect = [&](int a, int b) {
      parts.join(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
      pairs.push_back({std::min(a, b), std::max(a, b)});
    };
    const auto unique = [&] {
      std::sort(pairs.begin(), pairs.end());
      pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    };
    for (const RelativePose& e : graph.edges) connect(e.from, e.to);
    std::size_t most = 2 * pairs.size() + kPointBlock;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const auto seen = sightingsOf(k);
      for (std::size_t i = 0; i < seen.size(); ++i)
        for (std::size_t j = i + 1; j < seen.size(); ++j) connect(nodeOf(seen[i]), nodeOf(seen[j]));
      if (pairs.size() > most) {
        unique();
        most = 2 * pairs.size() + kPointBlock;
      }
    }
    unique();
    int count = 0;
    for (std::uint32_t i = 0; i < graph.poses.size(); ++i)
      of_pose_.push_back(parts.root(i) == i ? -1 : count++);
    for (const BlockCholesky::Pair& pair : pairs) {
      const int a = of_pose_[at(pair[0])], b = of_pose_[at(pair[1])];
      if (a >= 0 && b >= 0) pairs_.push_back({a, b});
    }
    system_ = std::make_unique<BlockCholesky>(count, 6, pairs_);
    gradient_.resize(6 * count);
  }

  void add(int a, int b, const Matrix6d& values) {
    if (a < 0 || b < 0) return;
    const bool swapped = a > b;
    const BlockCholesky::Pair pair{std::min(a, b), std::max(a, b)};
    const auto k =
        static_cast<std::size_t>(std::lower_bound(pairs_.begin(), pairs_.end(), pair) - pairs_.begin());
    if (swapped)
      system_->addPair6(k, values.transpose());
    else
      system_->addPair6(k, values);
  }

  // Optimises every point for the present poses and builds the normal equations of the poses; returns the
  // cost. A point that no longer can be seen where it is costs more than any other, so that no step is better
  // for losing it.
  double assemble() {
    constexpr double kFar_px = 1000;
    const double far2 = std::pow(kFar_px / (sigma_left_ * config_.loss), 2),
                 lost = config_.loss * config_.loss * std::log1p(far2) / (config_.widened * config_.widened);
    system_->setZero();
    gradient_.setZero();
    double cost = 0, weight = 0;
    Eigen::Vector2d squares = Eigen::Vector2d::Zero();
    for (const RelativePose& e : bundle_.graph.edges) {
      const RelativePoseLinear linear =
          linearize(e, bundle_.graph.poses[at(e.from)], bundle_.graph.poses[at(e.to)]);
      const int a = of_pose_[at(e.from)], b = of_pose_[at(e.to)];
      const Matrix6d from = linear.by_from.transpose() * e.information,
                     to = linear.by_to.transpose() * e.information;
      if (a >= 0) {
        system_->addDiagonal6(a, from * linear.by_from);
        gradient_.segment<6>(6 * a) += from * linear.error;
      }
      if (b >= 0) {
        system_->addDiagonal6(b, to * linear.by_to);
        gradient_.segment<6>(6 * b) += to * linear.error;
      }
      add(a, b, from * linear.by_to);
      cost += linear.error.dot(e.information * linear.error);
    }
    std::vector<Marginal> marginals(std::min(kPointBlock, points_.size()));
    for (std::size_t first = 0; first < points_.size(); first += kPointBlock) {
      const std::size_t end = std::min(points_.size(), first + kPointBlock);
      for_each_(first, end, [&](std::size_t k) { marginalise(k, marginals[k - first]); });
      for (std::size_t k = first; k < end; ++k) {
        const Marginal& m = marginals[k - first];
        if (!m.good) {
          cost += lost * static_cast<double>(sightingsOf(k).size());
          continue;
        }
        cost += m.cost;
        squares += m.squares;
        weight += m.weight;
        const auto seen = sightingsOf(k);
        std::size_t pair = 0;
        for (std::size_t i = 0; i < seen.size(); ++i) {
          const int a = of_pose_[at(nodeOf(seen[i]))];
          if (a >= 0) {
            system_->addDiagonal6(a, m.diagonal[i]);
            gradient_.segment<6>(6 * a) += m.gradient[i];
          }
          for (std::size_t j = i + 1; j < seen.size(); ++j)
            add(a, of_pose_[at(nodeOf(seen[j]))], m.pairs[pair++]);
        }
      }
    }
    if (weight > 0) {
      sigma_left_found_ = std::sqrt(squares.x() / weight);
      sigma_match_found_ = std::sqrt(squares.y() / weight);
    }
    return cost;
  }

  void marginalise(std::size_t point, Marginal& out) {
    constexpr int kRounds = 3;
    out.good = false;
    const auto seen = sightingsOf(point);
    const std::size_t n = seen.size();
    Eigen::Vector4d scale;
    scale << Eigen::Vector2d::Constant(1 / sigma_left_), Eigen::Vector2d::Constant(1 / sigma_match_);
    scale /= config_.widened;
    std::vector<Residual> residuals(n);
    std::vector<double> weights(n);
    Eigen::Matrix3d information, inverse;
    Eigen::Vector3d gradient;
    Eigen::Vector3d& position = points_[point];
    for (int round = 0; round < kRounds; ++round) {
      information.setZero();
      gradient.setZero();
      out.cost = out.weight = 0;
      out.squares.setZero();
      for (std::size_t i = 0; i < n; ++i) {
        const SE3& T = poseOf(seen[i]);
        Residual& r = residuals[i];
        if (!residualOf(bundle_.rig, seen[i], T.inverse() * position, r)) return;
        const double loss2 = config_.loss * config_.loss;
        const double chi2 = r.error.cwiseProduct(scale).squaredNorm() * config_.widened * config_.widened;
        weights[i] = 1 / (1 + chi2 / loss2);
        out.cost += loss2 * std::log1p(chi2 / loss2) / (config_.widened * config_.widened);
        out.squares += weights[i] *
                       Eigen::Vector2d(r.error.head<2>().squaredNorm(), r.error.tail<2>().squaredNorm()) / 2;
        out.weight += weights[i];
        r.error = r.error.cwiseProduct(scale).eval();
        r.by_point_in_camera = (scale.asDiagonal() * r.by_point_in_camera).eval();
        const Matrix43 by_place = r.by_point_in_camera * T.matrix3().transpose();
        information += weights[i] * by_place.transpose() * by_place;
        gradient += weights[i] * by_place.transpose() * r.error;
      }
      inverse = information.inverse();
      if (!inverse.allFinite()) return;
      if (round + 1 < kRounds) position -= inverse * gradient;
    }
    // Solving for the point takes 3 of its sightings' 4 n degrees of freedom.
    const double freedom = 1 - 3.0 / (4.0 * static_cast<double>(n));
    out.weight *= freedom;
    out.diagonal.assign(n, Matrix6d::Zero());
    out.gradient.assign(n, Vector6d::Zero());
    out.pairs.clear();
    std::vector<Matrix63> coupling(n);
    for (std::size_t i = 0; i < n; ++i) {
      const SE3& T = poseOf(seen[i]);
      const Eigen::Vector3d p = T.inverse() * position;
      Matrix46 by_pose;
      by_pose << -residuals[i].by_point_in_camera, residuals[i].by_point_in_camera * crossMatrix(p);
      const Matrix43 by_place = residuals[i].by_point_in_camera * T.matrix3().transpose();
      coupling[i] = weights[i] * by_pose.transpose() * by_place;
      out.diagonal[i] = weights[i] * by_pose.transpose() * by_pose;
      out.gradient[i] = weights[i] * by_pose.transpose() * residuals[i].error;
    }
    for (std::size_t i = 0; i < n; ++i) {
      const Matrix63 half = coupling[i] * inverse;
      out.diagonal[i] -= half * coupling[i].transpose();
      out.gradient[i] -= half * gradient;
      for (std::size_t j = i + 1; j < n; ++j) out.pairs.push_back(-half * coupling[j].transpose());
    }
    out.good = true;
  }

  Bundle& bundle_;
  const BundleConfig& config_;
  const ForEach& for_each_;
  double sigma_left_, sigma_match_, sigma_left_found_ = 0, sigma_match_found_ = 0;
  std::vector<Eigen::Vector3d> points_;
  std::vector<int> of_pose_;  // -1: fixed, one of each connected part
  std::vector<BlockCholesky::Pair> pairs_;
  std::unique_ptr<BlockCholesky> system_;
  Eigen::VectorXd gradient_;
};

}  // namespace

BundleResult adjust(Bundle& bundle, const BundleConfig& config, const ForEach& for_each) {
  if (bundle.first.size() < 2) return {};
  const ForEach one_by_one = [](std::size_t first, std::size_t end, const auto& one) {
    for (std::size_t k = first; k < end; ++k) one(k);
  };
  return Adjuster(bundle, config, for_each ? for_each : one_by_one).run();
}

}  // namespace fathom::slam

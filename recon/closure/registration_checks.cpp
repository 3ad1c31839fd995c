#include "recon/closure/registration_checks.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::closure {
namespace {

constexpr int kCountedCell = 3;  // least features of the overlap in a cell that counts

using Cells = std::array<int, kCellsAcross * kCellsDown>;

double logChoose(double n, double k) {
  return std::lgamma(n + 1) - std::lgamma(k + 1) - std::lgamma(n - k + 1);
}

// Whether both cameras of a frame see a point of its left camera frame.
bool isVisible(const StereoRig& rig, const Eigen::Vector3d& point) {
  constexpr double kMargin = 8;     // windows at the border find no match [px]
  constexpr double kNearest = 0.1;  // [m]
  if (point.z() < kNearest) return false;
  const Eigen::Vector3d in_right = rig.T_right_left * point;
  return in_right.z() >= kNearest && rig.left.contains(rig.left.project(point), kMargin) &&
         rig.right.contains(rig.right.project(in_right), kMargin);
}

// Features of a that have an inlier among their matches.
std::set<int> featuresThatFit(const std::vector<PointPair>& pairs, const std::vector<Match>& matches,
                              const SE3& pose, double gate) {
  std::set<int> fit;
  const Eigen::Matrix3d rotation = pose.matrix3();
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (squaredDistance(pairs[k], pose, rotation) < gate) fit.insert(matches[k].a);
  return fit;
}

}  // namespace

std::vector<PointPair> pointPairs(const StereoRig& rig, const SharedErrors& shared, const FrameFeatures& a,
                                  const FrameFeatures& b, const std::vector<Match>& matches) {
  const double baseline = rig.baseline();
  const auto sharedOf = [&](const Feature& f) {
    return sharedJacobian(shared, rig.left.fx, baseline, f.point.cast<double>());
  };
  std::vector<PointPair> pairs;
  pairs.reserve(matches.size());
  for (const Match& m : matches) {
    const Feature &fa = a.features[static_cast<std::size_t>(m.a)],
                  &fb = b.features[static_cast<std::size_t>(m.b)];
    pairs.push_back({fa.point.cast<double>(), fb.point.cast<double>(), fa.covarianceMatrix(),
                     fb.covarianceMatrix(), sharedOf(fa), sharedOf(fb)});
  }
  return pairs;
}

double distanceFromPrior(const SE3& T_a_b, const Matrix6d& covariance, const SE3& prior,
                         const Matrix6d& prior_covariance) {
  const Vector6d d = perturbation(prior, T_a_b);
  return d.dot((covariance + prior_covariance).ldlt().solve(d));
}

void maskByPrior(const FrameFeatures& a, const FrameFeatures& b, const SE3& prior,
                 const Matrix6d& prior_covariance, PairMask& mask) {
  constexpr double kGate = 16.27;  // 99.9 % of chi-square with 3 degrees of freedom
  // The covariance of a's point is taken as equal to b's, which is similar in depth and texture.
  constexpr double kBothPoints = 2;
  mask.resize(static_cast<Eigen::Index>(a.size()), static_cast<Eigen::Index>(b.size()));
  const Eigen::Matrix3d rotation = prior.matrix3();
  for (std::size_t j = 0; j < b.size(); ++j) {
    const Eigen::Vector3d point = b.features[j].point.cast<double>();
    const Eigen::Vector3d expected = prior * point;
    Eigen::Matrix<double, 3, 6> by_pose;
    by_pose << rotation, -rotation * crossMatrix(point);
    const Eigen::Matrix3d information =
        (by_pose * prior_covariance * by_pose.transpose() +
         kBothPoints * rotation * b.features[j].covarianceMatrix() * rotation.transpose())
            .inverse();
    for (std::size_t i = 0; i < a.size(); ++i) {
      const Eigen::Vector3d e = a.features[i].point.cast<double>() - expected;
      mask(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = e.dot(information * e) < kGate;
    }
  }
}

Distinct distinctFeatures(const FrameFeatures& a, const FrameFeatures& b, const Eigen::MatrixXf& distances,
                          const std::vector<Match>& inliers, double ratio) {
  std::vector<float> typical;
  for (const Match& m : inliers) typical.push_back(distances(m.a, m.b));
  if (typical.empty()) return {std::vector<bool>(a.size()), std::vector<bool>(b.size())};
  const auto least = static_cast<float>(static_cast<double>(median(std::move(typical))) / (ratio * ratio));
  const auto beyond = [least](const FrameFeatures& frame) {
    std::vector<bool> distinct;
    for (const float d : nearestElsewhere(frame)) distinct.push_back(d > least);
    return distinct;
  };
  return {beyond(a), beyond(b)};
}

OverlapUse overlapUse(const StereoRig& rig, const FrameFeatures& a, const FrameFeatures& b,
                      const std::vector<Match>& inliers, const Distinct& distinct, const SE3& T_a_b) {
  const SE3 T_b_a = T_a_b.inverse();
  Cells held{}, used{}, distinct_held{}, distinct_used{};
  const auto cellOf = [&](const Feature& f) {
    const auto along = [](float at, int size, int cells) {
      return std::clamp(static_cast<int>(at * static_cast<float>(cells) / static_cast<float>(size)), 0,
                        cells - 1);
    };
    return static_cast<std::size_t>(along(f.left.y(), rig.left.height, kCellsDown) * kCellsAcross +
                                    along(f.left.x(), rig.left.width, kCellsAcross));
  };
  int in_a = 0, in_b = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Feature& f = a.features[i];
    if (!isVisible(rig, T_b_a * f.point.cast<double>())) continue;
    ++in_a;
    ++held[cellOf(f)];
    distinct_held[cellOf(f)] += distinct.a[i] ? 1 : 0;
  }
  for (const Feature& f : b.features) in_b += isVisible(rig, T_a_b * f.point.cast<double>()) ? 1 : 0;
  OverlapUse use;
  for (const Match& m : inliers) {
    const auto i = static_cast<std::size_t>(m.a), j = static_cast<std::size_t>(m.b);
    ++used[cellOf(a.features[i])];
    if (!distinct.a[i] || !distinct.b[j]) continue;
    ++distinct_used[cellOf(a.features[i])];
    ++use.distinct_inliers;
  }
  const auto filled = [](const Cells& of, const Cells& by) {
    int cells = 0, full = 0;
    for (std::size_t c = 0; c < of.size(); ++c) {
      if (of[c] < kCountedCell) continue;
      ++cells;
      full += by[c] > 0 ? 1 : 0;
    }
    return cells > 0 ? static_cast<double>(full) / cells : 0.0;
  };
  use.features = std::min(in_a, in_b);
  use.share = static_cast<double>(inliers.size()) / std::max(use.features, 1);
  use.coverage = filled(held, used);
  use.distinct_coverage = filled(distinct_held, distinct_used);
  return use;
}

double significance(const FrameFeatures& a, const FrameFeatures& b, const PairMask* allowed,
                    std::size_t matches, std::size_t inliers, const SE3& T_a_b, double gate) {
  if (inliers < 4 || matches < inliers) return 0;
  const Eigen::Matrix3d rotation = T_a_b.matrix3();
  std::size_t tried = 0, fit = 0;
  for (std::size_t j = 0; j < b.size(); ++j) {
    const Eigen::Vector3d expected = T_a_b * b.features[j].point.cast<double>();
    const Eigen::Matrix3d spread = rotation * b.features[j].covarianceMatrix() * rotation.transpose();
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (allowed != nullptr && !(*allowed)(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)))
        continue;
      ++tried;
      const Eigen::Vector3d e = a.features[i].point.cast<double>() - expected;
      const Eigen::Matrix3d c = spread + a.features[i].covarianceMatrix();
      // A distance is at least that along the widest axis, which the trace bounds.
      if (e.squaredNorm() > gate * c.trace()) continue;
      fit += e.dot(c.inverse() * e) < gate ? 1 : 0;
    }
  }
  // The inliers themselves do not count as chance.
  const double by_chance = static_cast<double>(fit > inliers ? fit - inliers : 0) + 1;
  const double p = std::min(by_chance / (static_cast<double>(tried) + 1), 1.0);
  const auto m = static_cast<double>(matches), k = static_cast<double>(inliers);
  const double log_nfa =
      std::log(std::max(m - 3, 1.0)) + logChoose(m, k) + logChoose(k, 3) + (k - 3) * std::log(p);
  return -log_nfa / std::log(10.0);
}

double rivalShare(const std::vector<PointPair>& alike, const std::vector<Match>& matches, const SE3& pose,
                  double gate, const SampleConfig& sample) {
  const std::set<int> own = featuresThatFit(alike, matches, pose, gate);
  if (own.empty()) return 1;
  // A rival pose has other partners: pairs that fit this pose, or nearly, are left out.
  constexpr double kNearly = 9;  // in gates: three times the distance
  const Eigen::Matrix3d rotation = pose.matrix3();
  std::vector<PointPair> rest;
  for (const PointPair& p : alike)
    if (squaredDistance(p, pose, rotation) > kNearly * gate) rest.push_back(p);
  const auto rival = sampleConsensus(rest, sample, nullptr, nullptr);
  if (!rival) return 0;
  const SE3 refined = refineCauchy(rest, rival->T_a_b);
  const std::size_t best = std::max(featuresThatFit(alike, matches, rival->T_a_b, gate).size(),
                                    featuresThatFit(alike, matches, refined, gate).size());
  return static_cast<double>(best) / static_cast<double>(own.size());
}

}  // namespace fathom::closure

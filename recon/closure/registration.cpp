#include "recon/closure/registration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::closure {
namespace {

constexpr int kCountedCell = 3;  // least features of the overlap in a cell that counts

using Cells = std::array<int, kCellsAcross * kCellsDown>;

double logChoose(double n, double k) {
  return logFactorial(n) - logFactorial(k) - logFactorial(n - k);
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

void validateRegistration(const RegistrationConfig& c) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(std::string("registration: ") + what);
  };
  require(c.match.max_ratio > 0 && c.match.max_ratio <= 1, "max_ratio must be 0 to 1");
  require(c.match.near_tie_ratio > 0 && c.match.near_tie_ratio <= 1, "near_tie_ratio must be 0 to 1");
  require(c.match.max_alike >= 1, "max_alike must be at least 1");
  require(c.sample.max_samples >= 1 && c.sample.max_hypotheses >= 1, "samples must be at least 1");
  require(c.sample.gate > 0 && c.sample.confidence > 0 && c.sample.confidence < 1,
          "gate must be positive, confidence between 0 and 1");
  require(c.min_inliers >= 4, "min_inliers must be at least 4");
  require(c.covariance_scale > 0, "covariance_scale must be positive");
  require(c.max_sigma_position > 0 && c.max_sigma_angle > 0, "greatest sigmas must be positive");
}

bool usable(const RelativePrior& prior) {
  return prior.T_a_b.translation().allFinite() && prior.covariance.allFinite() &&
         prior.covariance.diagonal().minCoeff() > 0;
}

// Gate of sampled poses, which are noisier than the final one.
bool nearPrior(const void* context, const SE3& T_a_b) {
  constexpr double kSampleSigma[2] = {0.2, 0.1};  // of a pose from three points [m, rad]
  constexpr double kGate = 22.46;                 // 99.9 % of chi-square with 6 degrees of freedom
  const auto& prior = *static_cast<const RelativePrior*>(context);
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(kSampleSigma[0] * kSampleSigma[0]),
      Eigen::Vector3d::Constant(kSampleSigma[1] * kSampleSigma[1]);
  return distanceFromPrior(T_a_b, variance.asDiagonal(), prior.T_a_b, prior.covariance) < kGate;
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

std::string_view nameOf(Refusal refusal) {
  constexpr std::array<std::string_view, kRefusals> kNames{
      "accepted", "no features", "few matches",   "no pose",   "few inliers", "low share",
      "narrow",   "chance",      "contradiction", "ambiguous", "vague"};
  return kNames[static_cast<std::size_t>(refusal)];
}

struct Registrar::Impl {
  Impl(const StereoRig& r, const RegistrationConfig& c) : rig(r), config(c) {}
  void ended(const char* stage) const {
    if (observer) observer(stage);
  }
  [[nodiscard]] Refusal estimate(const FrameFeatures& a, const FrameFeatures& b, const RelativePrior* prior);
  [[nodiscard]] Refusal check(const FrameFeatures& a, const FrameFeatures& b, const RelativePrior* prior);

  StereoRig rig;
  RegistrationConfig config;
  Eigen::MatrixXf distances;
  PairMask mask;
  bool masked = false;
  Matches matches;
  Registration result;
  std::function<void(const char* stage)> observer;
};

Refusal Registrar::Impl::estimate(const FrameFeatures& a, const FrameFeatures& b,
                                  const RelativePrior* prior) {
  const auto enough = static_cast<std::size_t>(config.min_inliers);
  if (a.size() < enough || b.size() < enough) return Refusal::kNoFeatures;
  masked = prior != nullptr;
  if (masked) maskByPrior(a, b, prior->T_a_b, prior->covariance, mask);
  descriptorDistances(a, b, distances);
  matchDescriptors(a, b, distances, masked ? &mask : nullptr, config.match, matches);
  result.matches = static_cast<int>(matches.best.size());
  ended("match");
  if (matches.best.size() < enough) return Refusal::kFewMatches;

  const std::vector<PointPair> pairs = pointPairs(rig, config.shared, a, b, matches.best);
  const auto hypothesis =
      sampleConsensus(pairs, config.sample, prior != nullptr ? nearPrior : nullptr, prior);
  ended("sample");
  if (!hypothesis) return Refusal::kNoPose;
  const auto alignment = alignPoints(pairs, refineCauchy(pairs, hypothesis->T_a_b));
  ended("align");
  if (!alignment) return Refusal::kNoPose;
  result.T_a_b = alignment->T_a_b;
  result.covariance = config.covariance_scale * alignment->covariance;
  result.noise = alignment->noise;
  for (const int k : alignment->inliers) result.inliers.push_back(matches.best[static_cast<std::size_t>(k)]);
  return Refusal::kNone;
}

// Computes all checks, so that a report can show the margin of each; the first that fails names the refusal.
Refusal Registrar::Impl::check(const FrameFeatures& a, const FrameFeatures& b, const RelativePrior* prior) {
  const double gate = config.sample.gate * result.noise * result.noise;
  const Distinct distinct = distinctFeatures(a, b, distances, result.inliers, config.match.max_ratio);
  const OverlapUse use = overlapUse(rig, a, b, result.inliers, distinct, result.T_a_b);
  result.overlap_features = use.features;
  result.share = use.share;
  result.coverage = use.coverage;
  result.distinct_inliers = use.distinct_inliers;
  result.distinct_coverage = use.distinct_coverage;
  result.significance = significance(a, b, masked ? &mask : nullptr, matches.best.size(),
                                     result.inliers.size(), result.T_a_b, gate);
  if (prior != nullptr)
    result.prior_distance =
        distanceFromPrior(result.T_a_b, result.covariance, prior->T_a_b, prior->covariance);
  if (static_cast<int>(result.inliers.size()) < config.min_inliers) return Refusal::kFewInliers;
  if (result.share < config.min_inlier_share) return Refusal::kLowShare;
  if (std::min(result.coverage, result.distinct_coverage) < config.min_coverage) return Refusal::kNarrow;
  if (result.significance < config.min_significance) return Refusal::kChance;
  if (result.prior_distance > config.max_prior_distance) return Refusal::kContradiction;
  const Vector6d sigma = result.covariance.diagonal().cwiseSqrt();
  if (sigma.head<3>().maxCoeff() > config.max_sigma_position ||
      sigma.tail<3>().maxCoeff() > config.max_sigma_angle)
    return Refusal::kVague;
  // A rival pose fits what repeats; distinct features fit one pose alone.
  if (result.distinct_inliers >= config.min_inliers) return Refusal::kNone;
  result.rival_share = rivalShare(pointPairs(rig, config.shared, a, b, matches.alike), matches.alike,
                                  result.T_a_b, gate, config.sample);
  return result.rival_share > config.max_rival_share ? Refusal::kAmbiguous : Refusal::kNone;
}

Registrar::Registrar(const StereoRig& rig, const RegistrationConfig& config) {
  validateRegistration(config);
  impl_ = std::make_unique<Impl>(rig, config);
}

Registrar::~Registrar() = default;

void Registrar::setStageObserver(std::function<void(const char* stage)> observer) {
  impl_->observer = std::move(observer);
}

const Registration& Registrar::process(const FrameFeatures& a, const FrameFeatures& b,
                                       const std::optional<RelativePrior>& prior) {
  Impl& m = *impl_;
  m.result = {};
  const RelativePrior* known = prior ? &*prior : nullptr;
  if (known != nullptr && !usable(*known)) {
    m.result.refusal = Refusal::kContradiction;
    return m.result;
  }
  m.result.refusal = m.estimate(a, b, known);
  if (!m.result.accepted()) return m.result;
  m.result.refusal = m.check(a, b, known);
  m.ended("check");
  return m.result;
}

}  // namespace fathom::closure

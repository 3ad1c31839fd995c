#include "recon/closure/registration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "recon/closure/registration_checks.hpp"

namespace fathom::closure {
namespace {

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

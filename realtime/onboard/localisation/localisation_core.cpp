#include "realtime/onboard/localisation/localisation_core.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::onboard {
namespace {

// Of dead reckoning between two keyframes, as a prior that visual odometry must agree with: at best, and
// growing while a sensor is silent.
constexpr double kStepSigma = 0.05, kStepAngle = 0.03;       // [m], [rad]
constexpr double kUnlockedSpeed = 0.3, kUntiltedRate = 0.1;  // [m/s], [rad/s]
constexpr double kJumpAngle = 0.3;                           // after a jump of the compass [rad]
// Where that prior fails: the two frames still overlap, so that they cannot be farther apart than this.
constexpr double kAnySigma = 1.0, kAnyAngle = 0.5;  // [m], [rad]
// Between consecutive keyframes dead reckoning confirms the pose, and a ledge may fill most of the shared
// view. Against dead reckoning much more is asked for.
constexpr double kStepCoverage = 0.2, kStepShare = 0.05;
// Change of ranges [1] at a survey's altitude [m] from which visual odometry is estimated again.
constexpr double kWorthRenewing = 0.003, kSurveyRange = 2;
// So also when the turn that all steps share is known better by this factor, unless it was known well enough,
// or is another: DvlCalibration::curl() [rad/m].
constexpr double kKnownBetter = 0.4;
const Eigen::Array4d kKnownWell = {1e-3, 1e-3, 1e-3, 1e-4}, kWorthTurn = 1.5 * kKnownWell;
constexpr std::uint64_t kMostTurned = 2000;  // steps: each is registered again
constexpr int kStrictInliers = 40;
constexpr double kStrictShare = 0.2, kStrictSignificance = 40;
constexpr int kLastSteps = 50;      // of the graph, after the survey
constexpr int kLastRounds = 20000;  // registrations after the survey, at most

closure::FeatureConfig featureConfig(const LocalisationConfig& config) {
  closure::FeatureConfig features;
  features.max_features = config.features;
  return features;
}

closure::RegistrationConfig nearConfig() {
  closure::RegistrationConfig config;
  config.min_coverage = kStepCoverage;
  config.min_inlier_share = kStepShare;
  return config;
}

closure::RegistrationConfig farConfig() {
  closure::RegistrationConfig config;
  config.min_inliers = kStrictInliers;
  config.min_inlier_share = kStrictShare;
  config.min_significance = kStrictSignificance;
  return config;
}

slam::NavigationConfig graphConfig(const LocalisationConfig& config) {
  slam::NavigationConfig graph = config.graph;
  graph.max_keyframes = config.max_keyframes;
  return graph;
}

Matrix6d covarianceOf(double position, double angle) {
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(position * position), Eigen::Vector3d::Constant(angle * angle);
  return variance.asDiagonal();
}

}  // namespace

closure::DepthRange depthsAbout(double range) {
  constexpr double kNearest = 0.4, kFarthest = 2.5;  // relief of a reef and its edge
  return {kNearest * range, kFarthest * range};
}

LocalisationCore::LocalisationCore(const calibration::RigHistory& rigs, const LocalisationConfig& config,
                                   SlotStore* feature_slots)
    : config_(config),
      rigs_(rigs),
      camera_(rigs.rig(0).left),
      selection_(config),
      extractor_(rigs.rig(0), featureConfig(config)),
      near_(rigs.rig(0), nearConfig()),
      far_(rigs.rig(0), farConfig()),
      features_(feature_slots, config.max_keyframes, config.features, rigs),
      graph_(graphConfig(config)),
      search_(rigs.rig(0), config, graph_, features_) {
  noteCurl();
  for (Looked& looked : looked_) looked.features.reserve(static_cast<std::size_t>(config.features));
}

void LocalisationCore::setRig(const StereoRig& rig, const Eigen::Vector2d& growth) {
  extractor_.setRig(rig);
  graph_.rigChanged(growth);
  if (std::abs(calibration::rangeChange(rigs_.rig(seen_through_), rig).at(kSurveyRange)) > kWorthRenewing)
    renewLinks();
}

void LocalisationCore::resetRig(double turn_sigma, std::int64_t since_ns, bool knocked) {
  graph_.resetRig(turn_sigma, since_ns, knocked);
  const int newest = rigs_.newest();
  extractor_.setRig(rigs_.rig(newest));
  if (newest > 0 && rigs_.best(newest - 1) != newest) renew_from_ = graph_.keyframes();
  newest > 0 ? renewLinks() : noteCurl();
}

void LocalisationCore::noteCurl() {
  curl_ = graph_.dvl().curl();
  curl_sigma_ = graph_.dvl().curlSigma();
}

void LocalisationCore::renewIfCurlIsAnother() {
  const Eigen::Array4d known = graph_.dvl().curlSigma(), then = curl_sigma_,
                       off = (graph_.dvl().curl() - curl_).cwiseAbs();
  if (counters_.odometry_renewed < kMostTurned &&
      (off > kWorthTurn || (then > kKnownWell && known < kKnownBetter * then)).any())
    renewLinks();
}

void LocalisationCore::renewLinks() {
  noteCurl();
  seen_through_ = rigs_.newest();
  renew_ = (graph_.living().empty() ? 0 : std::max(renew_from_, graph_.living().front())) + 1;
  renew_end_ = graph_.keyframes();
}

void LocalisationCore::setAnchor(nav::FixKind kind, const Eigen::Vector2d& shift, double sigma) {
  if (kind == nav::FixKind::kUsbl)
    graph_.setUsblAnchor(shift, sigma);
  else
    graph_.setAnchor(shift, sigma);
}

void LocalisationCore::addFix(nav::FixKind kind, std::int64_t utc_ns, const Eigen::Vector3d& antenna_in_odom,
                              const Eigen::Vector2d& north_east, double sigma) {
  if (kind == nav::FixKind::kUsbl) sigma = usbl_wander_.add(utc_ns, sigma, config_.graph.noise);
  if (fixes_.pushDroppingOldest({kind, utc_ns, antenna_in_odom, north_east, sigma}))
    ++counters_.fixes_dropped;
}

bool LocalisationCore::odometryReliable(const LocalisationInput& input) const {
  return !graph_.dvlContradicted() && input.quality.unlocked_s <= last_unlocked_s_ &&
         input.quality.heading_leaps == last_quality_.heading_leaps;
}

closure::Footprint LocalisationCore::footprintOf(const LocalisationInput& input) const {
  return closure::footprintOf(input.T_odom_cam, input.range, camera_);
}

int LocalisationCore::look(const LocalisationInput& input) {
  // What predictions are off by.
  constexpr KeyframeSelection::Slack kPredicted = {0.012, 0.01};
  const auto room = std::ranges::find(looked_, false, &Looked::waits);
  if (room == looked_.end() || !selection_.due(input.utc_ns, input.T_odom_cam, footprintOf(input),
                                               odometryReliable(input), kPredicted))
    return kNoKeyframe;
  room->waits = true;
  room->rig = rigs_.newest();
  room->features = input.features != nullptr
                       ? *input.features
                       : extractor_.process(input.left, input.right, depthsAbout(input.range));
  ended("features");
  return static_cast<int>(room - looked_.begin());
}

int LocalisationCore::place(const LocalisationInput& input, int looked) {
  ++counters_.frames;
  Looked* kept = looked == kNoKeyframe ? nullptr : &looked_[static_cast<std::size_t>(looked)];
  const bool taken = kept != nullptr && selection_.take(input.utc_ns, input.T_odom_cam, footprintOf(input),
                                                        odometryReliable(input));
  last_unlocked_s_ = input.quality.unlocked_s;
  if (taken) {
    addKeyframe(input, *kept);
  } else {
    (void)graph_.step();
    ended("graph");
  }
  if (kept != nullptr) kept->waits = false;
  return graph_.keyframes() - 1;
}

double LocalisationCore::positionSigma(std::int64_t utc_ns, const SE3& T_odom_cam,
                                       const nav::DeadReckoning::Quality& quality) const {
  const int newest = graph_.keyframes() - 1;
  if (newest < 0) return position_sigma_;
  const double elapsed = rt::seconds(utc_ns - graph_.utcNs(newest)),
               distance = (T_odom_cam.translation() - graph_.odometry(newest).translation()).head<2>().norm();
  slam::LossOfTrack loss = loss_;
  const slam::StepQuality step{elapsed, loss.add(quality.unlocked_s - last_quality_.unlocked_s),
                               quality.untilted_s - last_quality_.untilted_s, graph_.dvl().remainingShare(),
                               0};
  return hypotenuse(position_sigma_, slam::stepSigma(distance, step, config_.graph.noise),
                    slam::wanderSigma(distance, elapsed, config_.graph.noise));
}

std::vector<UncertainView> LocalisationCore::views() {
  constexpr int kMost = 2000;  // covariances; neighbours' are alike
  const double half = 0.5 * hypotenuse(camera_.width / camera_.fx, camera_.height / camera_.fy);
  const int every = keyframes() / kMost + 1;
  std::vector<UncertainView> views;
  for (int k = 0; k < keyframes(); ++k) {
    if (!has(k)) continue;
    const double range = graph_.range(k), reach = half * range;
    UncertainView view{.T_nav_cam = keyframePose(k), .covariance = {}, .box = {}};
    const Eigen::Vector3d middle = view.T_nav_cam * Eigen::Vector3d(0, 0, range);
    view.covariance =
        views.size() % static_cast<std::size_t>(every) == 0 ? graph_.covariance(k) : views.back().covariance;
    view.box = {middle.x() - reach, middle.y() - reach, middle.x() + reach, middle.y() + reach};
    views.push_back(view);
  }
  return views;
}

void LocalisationCore::addKeyframe(const LocalisationInput& input, const Looked& looked) {
  const closure::FrameFeatures& found = looked.features;
  if (found.size() == 0) ++counters_.frames_without_features;
  auto keyframe = slam::KeyframeInput::between(last_quality_, input.quality);
  keyframe.utc_ns = input.utc_ns;
  keyframe.range = input.range;
  keyframe.T_odom_cam = input.T_odom_cam;
  keyframe.unlocked_s = loss_.add(input.quality.unlocked_s - last_quality_.unlocked_s);
  const auto number = graph_.addKeyframe(keyframe);
  noteRetired();
  if (!number) return;
  last_quality_ = input.quality;
  features_.add(found, input.T_odom_cam.translation(), looked.rig);
  search_.addKeyframe(*number, input.range);
  if (*number > 0) linkToLast(keyframe);
  renewLink();
  ended("visual odometry");
  (void)graph_.step();
  renewIfCurlIsAnother();
  applyFixes(false);
  ended("graph");
  search_.propose(*number);
  search_.proposeMoved();
  ended("candidates");
  if (input.closures) {
    search_.work(config_.closures_per_keyframe);
    search_.recognise(*number);
  }
  ended("closures");
  const Eigen::Matrix3d R = graph_.pose(*number).matrix3();
  const Eigen::Matrix2d spread =
      (R * graph_.covariance(*number).topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>();
  position_sigma_ = std::sqrt(std::max(symmetricEigenvalues(spread)(1), 0.0));
}

void LocalisationCore::noteRetired() {
  for (const slam::NavigationGraph::Retired& gone : graph_.retired()) {
    features_.retire(gone.keyframe);
    search_.removeKeyframe(gone.keyframe);
    if (on_retired_) on_retired_(gone);
  }
}

// Visual odometry to the newest keyframe. Dead reckoning is the prior; where that finds nothing, it may be
// wrong itself (a compass that jumps, outliers of the DVL), and the images decide if they are clear enough.
void LocalisationCore::linkToLast(const slam::KeyframeInput& input) {
  const int b = graph_.keyframes() - 1, a = b - 1;  // the newest do not retire
  const closure::FrameFeatures *before = features_.find(a), *now = features_.find(b);
  if (before == nullptr || now == nullptr) return;
  const SE3 T_a_b = graph_.odometry(a).inverse() * graph_.odometry(b);
  const double position = kStepSigma + kUnlockedSpeed * input.unlocked_s;
  const double angle =
      kStepAngle + kUntiltedRate * input.untilted_s + (input.compass_jumped ? kJumpAngle : 0.0);
  const closure::Registration* found =
      &near_.process(*before, *now, closure::RelativePrior{T_a_b, covarianceOf(position, angle)});
  if (!found->accepted() && found->refusal != closure::Refusal::kNoFeatures) {
    ++counters_.odometry_second_tries;
    found = &far_.process(*before, *now, closure::RelativePrior{T_a_b, covarianceOf(kAnySigma, kAnyAngle)});
    if (found->accepted()) ++counters_.odometry_surprises;
  }
  if (!found->accepted()) {
    ++counters_.odometry_refused;
    return;
  }
  ++counters_.odometry_found;
  const UncertainPose link{found->T_a_b, found->covariance};
  const bool confirmed = slam::worthConfirming(T_a_b, link.T_a_b) && confirms(a - 1, b, link);
  (void)graph_.addLink(slam::LinkKind::kOdometry, a, b, link.T_a_b, link.covariance, confirmed);
}

void LocalisationCore::renewLink() {
  if (renew_ >= renew_end_) return;
  const int b = renew_++, a = b - 1;
  if (!graph_.has(a) || !graph_.has(b)) return;
  const closure::FrameFeatures *before = features_.find(a), *now = features_.find(b);
  if (before == nullptr || now == nullptr) return;
  const SE3 T_a_b = graph_.odometry(a).inverse() * graph_.odometry(b);
  const closure::Registration& found =
      near_.process(*before, *now, closure::RelativePrior{T_a_b, covarianceOf(kStepSigma, kStepAngle)});
  if (!found.accepted()) return;
  graph_.renewOdometry(b, found.T_a_b, found.covariance);
  ++counters_.odometry_renewed;
}

// Whether a keyframe sees the newest one, with a wide prior, where the link to the newest has it.
bool LocalisationCore::confirms(int keyframe, int newest, const UncertainPose& link) {
  if (!graph_.has(keyframe)) return false;
  const closure::FrameFeatures *then = features_.find(keyframe), *now = features_.find(newest);
  if (then == nullptr || now == nullptr) return false;
  const UncertainPose between = graph_.predict(keyframe, newest - 1);
  const closure::Registration& both = far_.process(
      *then, *now, closure::RelativePrior{between.T_a_b * link.T_a_b, covarianceOf(kAnySigma, kAnyAngle)});
  return both.accepted() && closesTriangle({both.T_a_b, both.covariance}, between, link);
}

// Fixes up to the newest keyframe's time; `all`: the later ones too.
void LocalisationCore::applyFixes(bool all) {
  const int newest = graph_.keyframes() - 1;
  if (newest < 0) return;
  for (std::size_t i = 0; i < fixes_.size();) {
    const Fix fix = fixes_[i];
    if (!all && fix.utc_ns > graph_.utcNs(newest)) {
      ++i;
      continue;
    }
    fixes_.erase(i);
    (void)graph_.addFix(nearestKeyframe(fix.utc_ns), fix.antenna, fix.north_east, fix.sigma,
                        fix.kind == nav::FixKind::kUsbl);
  }
}

int LocalisationCore::nearestKeyframe(std::int64_t utc_ns) const {
  const std::span<const int> all = graph_.living();
  const auto after =
      std::ranges::lower_bound(all, utc_ns, {}, [&](int keyframe) { return graph_.utcNs(keyframe); });
  if (after == all.end()) return all.back();
  if (after == all.begin()) return *after;
  const int before = *std::prev(after);
  return utc_ns - graph_.utcNs(before) < graph_.utcNs(*after) - utc_ns ? before : *after;
}

void LocalisationCore::finish() {
  applyFixes(true);
  while (renew_ < renew_end_) renewLink();
  const auto settle = [&] {
    for (int i = 0; i < kLastSteps; ++i) {
      const slam::StepReport report = graph_.step();
      if (report.poses_moved == 0 && !report.waits_for_factor && report.measurements_waiting == 0) return;
    }
  };
  settle();
  for (int round = 0; round < kLastRounds && search_.counters().waiting > 0; ++round) {
    search_.work(config_.closures_per_keyframe);
    (void)graph_.step();
  }
  settle();
}

LocalisationCore::Counters LocalisationCore::counters() const {
  Counters out = counters_;
  out.fixes_waiting = fixes_.size();
  out.changes_waiting = graph_.changesWaiting();
  return out;
}

std::size_t LocalisationCore::memoryBytes() const {
  return graph_.memoryBytes() + features_.memoryBytes() + search_.memoryBytes() +
         kLooked * closure::slotBytes(static_cast<std::size_t>(config_.features));
}

}  // namespace fathom::onboard

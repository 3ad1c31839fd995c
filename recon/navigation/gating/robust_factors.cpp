#include "recon/navigation/gating/robust_factors.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr double kOffAt = 2;         // times what chance explains: a factor is switched off
constexpr double kNewWeight = 0.15;  // relative change of a weight that is worth the solver's work

}  // namespace

RobustFactors::RobustFactors(KeyframeStore& keyframes) : keyframes_(keyframes) {
  const NavigationConfig& config = keyframes.config();
  factors_.reserve(at(config.max_links + config.max_fixes));
  place_of_.resize(at(config.solver.max_measurements), -1);
}

bool RobustFactors::isShort(std::size_t spare) const {
  return factors_.size() + std::min(spare, factors_.capacity() / 8) >= factors_.capacity();
}

void RobustFactors::add(const RobustFactor& factor) {
  place_of_[at(factor.measurement)] = static_cast<int>(factors_.size());
  factors_.push_back(factor);
}

void RobustFactors::replaceMeasurement(RobustFactor& factor, int measurement) {
  std::swap(place_of_[at(measurement)], place_of_[at(factor.measurement)]);
  factor.measurement = measurement;
}

void RobustFactors::forget(int measurement) {
  const int place = place_of_[at(measurement)];
  if (place < 0) return;
  place_of_[at(measurement)] = -1;
  // Those before newest_ have been looked at once, those behind it have not.
  auto hole = at(place);
  if (hole < newest_) {
    move(--newest_, hole);
    hole = newest_;
  }
  move(factors_.size() - 1, hole);
  factors_.pop_back();
  if (next_ >= factors_.size()) next_ = 0;
}

void RobustFactors::move(std::size_t from, std::size_t to) {
  if (from == to) return;
  factors_[to] = factors_[from];
  place_of_[at(factors_[to].measurement)] = static_cast<int>(to);
}

void RobustFactors::reweight(bool settled, SharedTurns& turns) {
  if (factors_.empty()) return;
  int left = keyframes_.config().reweighted;
  for (; newest_ < factors_.size() && left > 0; ++newest_, --left)
    reweight(factors_[newest_], settled, turns);
  for (; left > 0; --left) {
    reweight(factors_[next_], settled, turns);
    next_ = (next_ + 1) % factors_.size();
  }
}

void RobustFactors::reweight(RobustFactor& r, bool settled, SharedTurns& turns) {
  turns.straightenAgain(r);
  if (r.confirmed) return;
  IncrementalSolver& solver = keyframes_.solver();
  const RelativePose factor = r.factor();
  const SE3 from = r.from == kWorld ? SE3() : solver.pose(r.from);
  const Vector6d e = relativePoseError(factor, from, solver.pose(r.to));
  const double chi2 = e.dot(factor.information * e);
  const bool off = r.off ? !(passesGate(r, turns) && settled) : settled && !(chi2 <= kOffAt * r.free_chi2);
  NavigationCounters& counters = keyframes_.counters();
  std::uint64_t& offs = r.fix ? counters.fixes_off : counters.links_off;
  if (off && !r.off) ++offs;
  if (!off && r.off) --offs;
  const double wanted = off ? 0 : cauchyWeight(chi2, r.free_chi2);
  if (off != r.off || std::abs(wanted - r.weight) > kNewWeight * r.weight) {
    (void)solver.setWeight(r.measurement, wanted);
    r.weight = wanted;
  }
  r.off = off;
}

// A factor that is switched off, by what the rest says.
bool RobustFactors::passesGate(const RobustFactor& r, SharedTurns& turns) const {
  const IncrementalSolver& solver = keyframes_.solver();
  const NavigationConfig& config = keyframes_.config();
  if (r.fix) {
    const SE3 from = r.from == kWorld ? SE3() : solver.pose(r.from);
    const Vector6d e = relativePoseError(r.factor(), from, solver.pose(r.to));
    return e.dot(r.spread * e) <= r.free_chi2;
  }
  const Matrix6d known = turns.relativeCovariance(r.from, r.to);
  return keyframes_.distance2(r.factor(), config.known_scale * known + r.spread) <= config.gate;
}

bool RobustFactors::rebuildIndices() {
  std::fill(place_of_.begin(), place_of_.end(), -1);
  for (std::size_t i = 0; i < factors_.size(); ++i) {
    const RobustFactor& r = factors_[i];
    const bool good = (r.from == kWorld || keyframes_.isNode(r.from)) && keyframes_.isNode(r.to) &&
                      keyframes_.isMeasurement(r.measurement) && !has(r.measurement) &&
                      r.spread.allFinite() && r.straightened_by.allFinite() &&
                      r.factor().information.allFinite();
    if (!good) return false;
    place_of_[at(r.measurement)] = static_cast<int>(i);
  }
  return (next_ < factors_.size() || next_ == 0) && newest_ <= factors_.size();
}

SharedTurns::SharedTurns(KeyframeStore& keyframes, DvlCalibration& dvl, RobustFactors& robust)
    : keyframes_(keyframes),
      solver_(keyframes.solver()),
      dvl_(dvl),
      robust_(robust),
      links_(keyframes.config().solver.max_poses),
      closures_(keyframes.config().solver.max_poses) {}

void SharedTurns::hang(int node, int from, const SE3& T_nav_cam, const SharedByPose::Each& link_error) {
  links_.hang(node, from, T_nav_cam, link_error);
}

void SharedTurns::hangKeyframe(int node, int from, const SE3& T_nav_cam) {
  for (SharedByPose* errors : {&links_, &closures_})
    errors->hang(node, from, T_nav_cam, SharedByPose::Each::Zero());
}

Matrix6d SharedTurns::relativeCovariance(int from, int to) {
  return solver_.relativeCovariance(from, to) +
         links_.covariance(from, to, solver_.pose(to), dvl_.curlCovariance());
}

Matrix6d SharedTurns::covariance(int node) {
  return solver_.covariance(node) +
         links_.covariance(kWorld, node, solver_.pose(node), dvl_.curlCovariance());
}

void SharedTurns::resetRig(double turn_sigma) {
  dvl_.resetRig(turn_sigma);
  ++rig_epoch_;
  ++curl_epoch_;
}

void SharedTurns::restart() {
  pullLinks();
  while (!links_.solve(solver_)) continue;
  in_closures_ = pulled_ = false;
}

void SharedTurns::follow() {
  SharedByPose& followed = in_closures_ ? closures_ : links_;
  if (!pulled_) {
    forgetReplaced();
    in_closures_ ? pullClosures() : pullLinks();
    pulled_ = true;
  } else if (followed.solve(solver_)) {
    if (in_closures_) learnFromClosures();
    in_closures_ = !in_closures_;
    pulled_ = false;
  }
}

// Measurements composed of links of retired keyframes have such errors too.
void SharedTurns::pullLinks() {
  links_.begin();
  for (int k = 0; k < solver_.measurements(); ++k) {
    const Measurement& m = solver_.measurement(k);
    if (!m.in_use || m.weight == 0 || m.from < 0) continue;
    const int a = keyframes_.ofNode(m.from), b = keyframes_.ofNode(m.to);
    if (a < 0 || b < 0) continue;
    const Keyframe& to = keyframes_[b];
    if (m.composed || to.link == k || robust_.has(k)) links_.add(solver_, k, turnedBy(m.T_from_to, to.range));
  }
}

// take(closure, its roll and pitch by curl()) of all closures: they tilt
// a survey that depths and attitudes hold.
void SharedTurns::forLevelTurns(const auto& take) const {
  for (const RobustFactor& r : robust_.all()) {
    if (r.fix || r.weight < 1 || r.curl_epoch != curl_epoch_) continue;
    const double range = keyframes_[keyframes_.ofNode(r.to)].range;
    const Eigen::Vector3d down = solver_.pose(r.to).rotation().conjugate() * Eigen::Vector3d::UnitZ();
    take(r, turnedBy(r.T_from_to, range, Eigen::Matrix3d::Identity() - down * down.transpose()));
  }
}

void SharedTurns::pullClosures() {
  closures_.begin();
  forLevelTurns([&](const RobustFactor& r, const SharedByPose::Each& by) {
    closures_.add(solver_, r.measurement, by);
  });
}

void SharedTurns::learnFromClosures() {
  SharedByPose::Evidence all;
  forLevelTurns([&](const RobustFactor& r, const SharedByPose::Each& by) {
    closures_.addEvidence(solver_, r.measurement, by, dvl_.curl() - r.straightened_by, all);
  });
  dvl_.setClosures(all.information, all.sum);
}

void SharedTurns::learnFromYaw(int a, int b, const UncertainPose& seen) {
  constexpr int kLongest = 500;  // steps
  constexpr double kShared = 4;  // closures of neighbours see by the same steps and attitudes
  if (b - a > kLongest || keyframes_[a].visual_turn.rig != rig_epoch_ ||
      keyframes_[b].visual_turn.rig != rig_epoch_)
    return;
  const VisualTurn own(seen.T_a_b, seen.covariance, rig_epoch_);
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  double variance = 0;
  Eigen::RowVector4d by = Eigen::RowVector4d::Zero();
  const auto add = [&](const Keyframe& at_end, const VisualTurn& s, const SE3& T_seen, double sign) {
    const Eigen::RowVector3d down = at_end.T_odom_cam.rotation().toRotationMatrix().row(2);
    variance += down.cwiseAbs2() * s.variance;
    by += sign * down * turnedBy(T_seen, at_end.range).bottomRows<3>();
  };
  for (int k = a + 1; k <= b; ++k) {
    if (!keyframes_.has(k)) return;
    const Keyframe& f = keyframes_[k];
    if (f.visual_turn.rig != rig_epoch_ || f.link < 0 || f.visualRejected()) return;
    turn = turn * f.visual_turn.turn;
    add(f, f.visual_turn, solver_.measurement(f.link).T_from_to, 1);
  }
  add(keyframes_[b], own, seen.T_a_b, -1);
  const SE3 off(turn * own.turn.conjugate(), Eigen::Vector3d::Zero());
  dvl_.addTurn((keyframes_[a].T_odom_cam.rotation() * off.log().tail<3>()).z(), kShared * variance, by);
}

void SharedTurns::straightenAgain(RobustFactor& r) {
  constexpr double kWorth = 0.2;  // standard deviations of the estimate
  if (r.fix || r.off || r.curl_epoch != curl_epoch_ || solver_.waiting() > 0) return;
  const Eigen::Vector4d off = dvl_.curl() - r.straightened_by;
  if ((off.array().abs() <= kWorth * dvl_.curlSigma().array()).all()) return;
  const double range = keyframes_[keyframes_.ofNode(r.to)].range;
  const SE3 T_from_to = r.T_from_to * SE3::exp(-(turnedBy(r.T_from_to, range) * off));
  const int measurement = keyframes_.addFactor(linkFactor(r.from, r.to, T_from_to, r.spread));
  if (measurement < 0) return;
  if (r.weight != 1) (void)solver_.setWeight(measurement, r.weight);
  (void)solver_.setWeight(r.measurement, 0);
  robust_.replaceMeasurement(r, measurement);
  r.T_from_to = T_from_to;
  r.straightened_by += off;
}

void SharedTurns::renewOdometry(int number, const SE3& seen, const Matrix6d& covariance) {
  if (!keyframes_.has(number) || !keyframes_.has(number - 1)) return;
  Keyframe& keyframe = keyframes_[number];
  const SE3 T_a_b = dvl_.straightened(seen, keyframe.range);
  const int measurement = keyframes_.addFactor(linkFactor(keyframes_[number - 1].node, keyframe.node, T_a_b,
                                                          covariance + dvl_.leftOpen(T_a_b, keyframe.range)));
  if (measurement < 0) return;
  if (keyframe.link >= 0) (void)solver_.setWeight(keyframe.link, 0);
  keyframe.visual_turn = {seen, covariance, rig_epoch_};
  keyframe.link = measurement;
  keyframe.link_rejected = false;
  keyframes_.weigh(keyframe);
}

// Forgets links that another has replaced.
void SharedTurns::forgetReplaced() {
  for (int k = 0; k < solver_.measurements(); ++k) {
    const Measurement& m = solver_.measurement(k);
    if (!m.in_use || m.weight != 0 || m.from < 0 || robust_.has(k)) continue;
    const int a = keyframes_.ofNode(m.from), b = keyframes_.ofNode(m.to);
    if (a >= 0 && b >= 0 && keyframes_[b].link != k && keyframes_[b].step != k) (void)solver_.forget(k);
  }
}

}  // namespace fathom::slam

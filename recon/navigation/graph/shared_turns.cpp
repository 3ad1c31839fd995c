#include "recon/navigation/graph/shared_turns.hpp"

#include <Eigen/Dense>

namespace fathom::slam {

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
    if (m.composed || to.link == k || robust_.has(k))
      links_.pull(solver_, k, turnedBy(m.T_from_to, to.range));
  }
}

// take(closure, its roll and pitch by curl()) of all closures: they tilt
// a survey that depths and attitudes hold.
template <typename Take>
void SharedTurns::forLevelTurns(const Take& take) const {
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
    closures_.pull(solver_, r.measurement, by);
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

// Turns that links share because they see through one rig: what tells them, and links that enter anew.
#include <Eigen/Dense>
#include <utility>

#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {

// A part of what errors that visual links share do to poses, and closures among these.
void NavigationGraph::followShared() {
  SharedByPose& followed = of_closures_ ? closures_ : shared_;
  if (!pulled_) {
    forgetReplaced();
    of_closures_ ? pullClosures() : pullShared();
    pulled_ = true;
  } else if (followed.solve(solver_)) {
    if (of_closures_) learnCurves();
    of_closures_ = !of_closures_;
    pulled_ = false;
  }
}

// What was composed of links that are gone has such errors too.
void NavigationGraph::pullShared() {
  shared_.begin();
  for (int k = 0; k < solver_.measurements(); ++k) {
    const Measurement& m = solver_.measurement(k);
    if (!m.in_use || m.weight == 0 || m.from < 0) continue;
    const int a = frame_of_node_[at(m.from)], b = frame_of_node_[at(m.to)];
    if (a < 0 || b < 0) continue;
    const Frame& to = frames_[at(b)];
    if (m.composed || to.link == k || robust_of_[at(k)] >= 0)
      shared_.pull(solver_, k, turnedBy(m.T_from_to, to.range));
  }
}

// take(closure, its roll and pitch by curl()) of all closures: they tilt a survey that depths and attitudes
// hold.
template <typename Take>
void NavigationGraph::forLevelTurns(const Take& take) const {
  for (const Robust& r : robust_) {
    if (r.fix || r.weight < 1 || r.curved != curved_) continue;
    const double range = frames_[at(frame_of_node_[at(r.to)])].range;
    const Eigen::Vector3d down = solver_.pose(r.to).rotation().conjugate() * Eigen::Vector3d::UnitZ();
    take(r, turnedBy(r.T_from_to, range, Eigen::Matrix3d::Identity() - down * down.transpose()));
  }
}

void NavigationGraph::pullClosures() {
  closures_.begin();
  forLevelTurns(
      [&](const Robust& r, const SharedByPose::Each& by) { closures_.pull(solver_, r.measurement, by); });
}

void NavigationGraph::learnCurves() {
  SharedByPose::Evidence all;
  forLevelTurns([&](const Robust& r, const SharedByPose::Each& by) {
    closures_.addEvidence(solver_, r.measurement, by, dvl_.curl() - r.straightened_by, all);
  });
  dvl_.setClosures(all.information, all.sum);
}

// How curved ranges turn what cameras see, by a closure's yaw against visual odometry, if that never failed
// between them.
void NavigationGraph::learnTurn(int a, int b, const UncertainPose& seen) {
  constexpr int kLongest = 500;  // steps
  constexpr double kShared = 4;  // closures of neighbours see by the same steps and attitudes
  if (b - a > kLongest || frames_[at(a)].seen.rig != rig_ || frames_[at(b)].seen.rig != rig_) return;
  const SeenTurn own(seen.T_a_b, seen.covariance, rig_);
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  double variance = 0;
  Eigen::RowVector4d by = Eigen::RowVector4d::Zero();
  const auto add = [&](const Frame& at_end, const SeenTurn& s, const SE3& T_seen, double sign) {
    const Eigen::RowVector3d down = at_end.T_odom_cam.rotation().toRotationMatrix().row(2);
    variance += down.cwiseAbs2() * s.variance;
    by += sign * down * turnedBy(T_seen, at_end.range).bottomRows<3>();
  };
  for (int k = a + 1; k <= b; ++k) {
    if (!has(k)) return;
    const Frame& f = frames_[at(k)];
    if (f.seen.rig != rig_ || f.link < 0 || f.visualLies()) return;
    turn = turn * f.seen.turn;
    add(f, f.seen, solver_.measurement(f.link).T_from_to, 1);
  }
  add(frames_[at(b)], own, seen.T_a_b, -1);
  const SE3 off(turn * own.turn.conjugate(), Eigen::Vector3d::Zero());
  dvl_.addTurn((frames_[at(a)].T_odom_cam.rotation() * off.log().tail<3>()).z(), kShared * variance, by);
}

// A closure whose turn, straightened() by what was known then, is another by what is known now. Not while the
// factor lacks newer ones: what it lacks is not known to closures that are sought.
void NavigationGraph::straightenAnew(Robust& r) {
  constexpr double kWorth = 0.2;  // standard deviations of the estimate
  if (r.fix || r.off || r.curved != curved_ || solver_.waiting() > 0) return;
  const Eigen::Vector4d off = dvl_.curl() - r.straightened_by;
  if ((off.array().abs() <= kWorth * dvl_.curlSigma().array()).all()) return;
  const double range = frames_[at(frame_of_node_[at(r.to)])].range;
  const SE3 T_from_to = r.T_from_to * SE3::exp(-(turnedBy(r.T_from_to, range) * off));
  const int measurement = addFactor(linkFactor(r.from, r.to, T_from_to, r.spread));
  if (measurement < 0) return;
  if (r.weight != 1) (void)solver_.setWeight(measurement, r.weight);
  (void)solver_.setWeight(r.measurement, 0);
  std::swap(robust_of_[at(measurement)], robust_of_[at(r.measurement)]);
  r.measurement = measurement;
  r.T_from_to = T_from_to;
  r.straightened_by += off;
}

void NavigationGraph::renewOdometry(int keyframe, const SE3& seen, const Matrix6d& covariance) {
  if (!has(keyframe) || !has(keyframe - 1)) return;
  Frame& frame = frames_[at(keyframe)];
  const SE3 T_a_b = dvl_.straightened(seen, frame.range);
  const int measurement = addFactor(linkFactor(frames_[at(keyframe - 1)].node, frame.node, T_a_b,
                                               covariance + dvl_.leftOpen(T_a_b, frame.range)));
  if (measurement < 0) return;
  if (frame.link >= 0) (void)solver_.setWeight(frame.link, 0);
  frame.seen = {seen, covariance, rig_};
  frame.link = measurement;
  frame.link_slips = false;
  weigh(frame);
}

// Links in whose place another is.
void NavigationGraph::forgetReplaced() {
  for (int k = 0; k < solver_.measurements(); ++k) {
    const Measurement& m = solver_.measurement(k);
    if (!m.in_use || m.weight != 0 || m.from < 0 || robust_of_[at(k)] >= 0) continue;
    const int a = frame_of_node_[at(m.from)], b = frame_of_node_[at(m.to)];
    if (a >= 0 && b >= 0 && frames_[at(b)].link != k && frames_[at(b)].step != k) (void)solver_.forget(k);
  }
}

}  // namespace fathom::slam

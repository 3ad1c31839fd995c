#include "recon/navigation/gating/step_gate.hpp"

#include <cmath>

namespace fathom::slam {

StepGate::StepGate(KeyframeStore& keyframes, DvlCalibration& dvl, SensorReferences& references)
    : keyframes_(keyframes), references_(references), velocity_(keyframes, dvl) {}

StepTurns StepGate::turnsOf(const Keyframe& from, const Keyframe& to) const {
  const NavigationConfig& config = keyframes_.config();
  StepTurns turns;
  const double before = headingOf(from.T_odom_cam, config.forward_in_camera);
  turns.seconds = to.quality.seconds;
  turns.compass = wrapAngle(headingOf(to.T_odom_cam, config.forward_in_camera) - before);
  turns.compass_held = to.attitude < 0;
  turns.compass_jumped = to.compass_jumped;
  turns.has_gyro = to.ungyro_s == 0;
  turns.gyro = to.gyro_turn;
  turns.gyro_sigma = config.noise.gyro_walk * std::sqrt(std::max(turns.seconds, 0.0));
  turns.has_visual = visual_.linked;
  if (visual_.linked) {
    const SE3 seen = from.T_odom_cam * visual_.link.T_a_b;
    turns.visual = wrapAngle(headingOf(seen, config.forward_in_camera) - before);
    turns.confirmed = visual_.confirmed ||
                      (to.quality.seconds_unlocked == 0 &&
                       velocity_.agreesButForYaw(from, to, visual_, wrapAngle(turns.visual - turns.compass)));
    const Eigen::Vector3d down = seen.rotation().conjugate() * Eigen::Vector3d::UnitZ();
    turns.visual_sigma =
        std::sqrt(std::max(0.0, down.dot(visual_.link.covariance.bottomRightCorner<3, 3>() * down)));
  }
  return turns;
}

void StepGate::addGyro(const Keyframe& from, const Keyframe& to, const StepTurns& turns) {
  if (!turns.has_gyro) return;
  const double turn = wrapAngle(turns.gyro - heading_.gyroBias() * turns.seconds);
  (void)keyframes_.addFactor(gyroFactor(from.node, to.node, from.T_odom_cam, to.T_odom_cam,
                                        turn - turns.compass, heading_.gyroSigma(turns)));
}

bool StepGate::judge() {
  if (!waits_) return true;
  waits_ = false;
  const SensorNoise& noise = keyframes_.config().noise;
  const int newest = keyframes_.next() - 1;
  const Keyframe& from = keyframes_[newest - 1];
  Keyframe& to = keyframes_[newest];
  const StepTurns turns = turnsOf(from, to);
  heading_.add(turns);
  to.heading.visual = heading_.verdict(newest - 1).visual;
  const double contradiction = std::abs(wrapAngle(turns.visual - turns.compass)),
               sigma = std::hypot(turns.visual_sigma, 2 * noise.heading,
                                  noise.deviation_turn * std::sqrt(std::abs(turns.compass)));
  if (turns.has_visual && contradiction > keyframes_.config().turned_sigmas * sigma)
    ++keyframes_.counters().steps_contradicted;
  addGyro(from, to, turns);
  if (turns.has_visual && to.heading.visual && contradiction > sigma) {
    const double path = visual_.link.T_a_b.translation().norm(),
                 step_sigma = stepSigma(path, to.quality, noise), turned = kMeanTurn * contradiction * path;
    to.step_weight = step_sigma * step_sigma / (step_sigma * step_sigma + turned * turned);
  }
  velocity_.judge(from, to, visual_);
  visual_.linked = false;
  takeVerdicts(static_cast<int>(heading_.firstChanged()) + 1);
  const bool seen = to.visualAccepted(), reckoned = !to.dvl_rejected && !keyframes_.counters().dvl_rejected &&
                                                    to.quality.seconds_unlocked == 0;
  const bool headed = seen || turns.has_gyro || (to.heading.compass && to.attitude >= 0);
  // Where images saw it: in a turn the compass lags by many of their standard deviations.
  IncrementalSolver& solver = keyframes_.solver();
  if (seen && solver.startAt(to.node, solver.pose(from.node) * visual_.link.T_a_b))
    to.known = solver.pose(to.node);
  return headed && (seen || reckoned);
}

// Verdicts on the heading from a keyframe on. Where the compass has another
// reference, the drift to the first one that begins there or later is inflated;
// readings in between, of a reference that mixes both, are rejected.
void StepGate::takeVerdicts(int keyframe) {
  bool mixed = keyframes_.has(keyframe - 1) && keyframes_[keyframe - 1].mixed_reference;
  for (int number = keyframe; number < keyframes_.next(); ++number) {
    if (!keyframes_.has(number)) continue;
    Keyframe& k = keyframes_[number];
    const bool had_jumped = k.heading.restarts;
    k.heading = heading_.verdict(number - 1);
    if (!k.compass_jumped && k.heading.restarts && !had_jumped) ++keyframes_.counters().compass_jumps;
    if (!k.compass_jumped && !k.heading.restarts && had_jumped) --keyframes_.counters().compass_jumps;
    mixed = mixed || k.heading.restarts;
    if (k.heading.restarts) references_.noteJump(k.utc_ns);
    if (k.drift >= 0) {
      const double weight = mixed ? KeyframeStore::kInflated : 1;
      if (keyframes_.solver().measurement(k.drift).weight != weight)
        (void)keyframes_.solver().setWeight(k.drift, weight);
      mixed = false;
    }
    k.mixed_reference = mixed;
    keyframes_.weigh(k);
  }
  references_.setJumpWaits(mixed);
}

void StepGate::resetRig(std::int64_t since_ns, bool knocked) {
  velocity_.reset();
  const std::span<const int> all = keyframes_.living();
  for (std::size_t i = all.size(); i-- > 0 && keyframes_[all[i]].utc_ns >= since_ns;) {
    Keyframe& keyframe = keyframes_[all[i]];
    keyframe.dvl_rejected = false;
    keyframe.link_rejected = keyframe.link_rejected || (knocked && keyframe.link >= 0);
    keyframes_.weigh(keyframe);
  }
}

}  // namespace fathom::slam

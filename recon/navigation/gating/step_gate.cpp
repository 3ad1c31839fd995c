#include "recon/navigation/gating/step_gate.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::slam {
namespace {

constexpr double kYawUnjudged = 1.0;  // variance of a step's yaw, which HeadingGate judges [rad^2]
// Of a turn by visual odometry, the error that lenses and the rig leave (turns of 40 degrees in dives with
// all disturbances: 0.5 degrees).
constexpr double kOfTurn = 0.01;
// A velocity that differs from the one before by twice as much as the other, and this, is the outlier.
constexpr double kOutlierRatio = 2, kLeastChange_mps = 0.05;
constexpr double kStaleVelocity_s = 10;  // older, it says nothing of the present one

// A path in odom's axes, level, ahead and to starboard of a heading [m].
Eigen::Vector2d levelPath(const Eigen::Vector3d& path, double heading) {
  return Eigen::Rotation2Dd(-heading) * Eigen::Vector2d(path.head<2>());
}

}  // namespace

bool VelocityGate::agreesButForYaw(const Keyframe& from, const Keyframe& to, const VisualStep& visual,
                                   double contradiction) const {
  const NavigationConfig& config = keyframes_.config();
  const SensorNoise& noise = config.noise;
  const SE3 &T_a_b = visual.link.T_a_b, T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  const double path = T_a_b.translation().norm(),
               place = hypotenuse(stepSigma(path, to.quality, noise), kMeanTurn * contradiction * path);
  const Matrix6d at_dvl = perturbationAt(config.dvl_in_camera);
  const SE3 T_odom_seen = from.T_odom_cam * T_a_b;
  // Nav's axes, in which depth and yaw are, seen from the camera, however that is mounted.
  const Eigen::Matrix3d R = T_odom_seen.matrix3();
  const double depth = hypotenuse(noise.depth, to.quality.pressure_sigma),
               vertical = hypotenuse(place, 2 * depth), tilt = 2 * noise.tilt;
  const Eigen::Vector3d place2(place * place, place * place, vertical * vertical),
      turn2(tilt * tilt, tilt * tilt, kYawUnjudged);
  Matrix6d spread = Matrix6d::Zero();
  spread.topLeftCorner<3, 3>() = R.transpose() * place2.asDiagonal() * R;
  spread.bottomRightCorner<3, 3>() = R.transpose() * turn2.asDiagonal() * R;
  Vector6d e = perturbationOf({0, 1, T_a_b, Matrix6d::Identity()}, from.T_odom_cam, T_odom_to);
  e.head<3>() = T_odom_seen.rotation().conjugate() *
                (T_odom_to * config.dvl_in_camera - T_odom_seen * config.dvl_in_camera);
  const Matrix6d seen = visual.link.covariance + dvl_.leftOpen(T_a_b, to.range);
  const Matrix6d covariance = spread + at_dvl * seen * at_dvl.transpose();
  return e.dot(covariance.ldlt().solve(e)) <= config.gate;
}

void VelocityGate::judge(const Keyframe& from, Keyframe& to, const VisualStep& visual) {
  const NavigationConfig& config = keyframes_.config();
  NavigationCounters& counters = keyframes_.counters();
  const double elapsed = std::max(to.quality.seconds, 1e-3),
               heading = headingOf(from.T_odom_cam, config.forward_in_camera);
  const auto velocity = [&](const SE3& T_odom_then) -> Eigen::Vector2d {
    return levelPath(T_odom_then * config.dvl_in_camera - from.T_odom_cam * config.dvl_in_camera, heading) /
           elapsed;
  };
  const Eigen::Vector2d by_reckoning = velocity(dvl_.corrected(from.T_odom_cam, to.T_odom_cam));
  const bool locked = to.quality.seconds_unlocked == 0;
  const auto vehicleCanComeTo = [&](const Eigen::Vector2d& next, double seconds) {
    return (next - velocity_).norm() <= kLeastChange_mps + kMostAcceleration * seconds;
  };
  unseen_s_ += elapsed;
  if (!visual.linked) {
    // A false bottom may begin just where images show nothing.
    if (locked && !counters.dvl_rejected && vehicleCanComeTo(by_reckoning, unseen_s_))
      velocity_ = by_reckoning, unseen_s_ = 0;
    if (!locked) bridge(from, to, elapsed);
    return;
  }
  unseen_s_ = 0;
  const Eigen::Vector2d by_images = velocity(from.T_odom_cam * visual.link.T_a_b);
  const auto calibrate = [&] {
    if (locked && to.heading.visual)
      (void)dvl_.add(from.T_odom_cam, to.T_odom_cam, visual.T_a_b, visual.link.covariance, to.quality,
                     to.range);
  };
  if (agreesButForYaw(from, to, visual, 0)) {
    // A DVL that has lost the bottom contradicts no more: the images go on as before, or they do not.
    if (!locked && !vehicleCanComeTo(by_images, elapsed)) rejectDvlInstead();
    contradictions_ = rejected_links_ = 0;
    if (++agreements_ >= config.reject_after) counters.dvl_rejected = false;
    velocity_ = by_images;
    calibrate();
    return;
  }
  ++counters.steps_contradicted;
  agreements_ = 0;
  const double change_by_dvl = (by_reckoning - velocity_).norm(),
               change_by_images = (by_images - velocity_).norm();
  const bool known = from.quality.seconds > 0 && elapsed < kStaleVelocity_s;
  if (locked && !counters.dvl_rejected && known && rejected_links_ < config.reject_after &&
      change_by_images > kOutlierRatio * change_by_dvl + kLeastChange_mps) {
    to.link_rejected = true;
    contradictions_ = 0;
    ++rejected_links_;
    velocity_ = by_reckoning;
    return;
  }
  rejectDvlInstead();
  to.dvl_rejected = true;
  velocity_ = by_images;
  calibrate();
  if (++contradictions_ >= config.reject_after) counters.dvl_rejected = true;
}

void VelocityGate::bridge(const Keyframe& from, const Keyframe& to, double elapsed) {
  const NavigationConfig& config = keyframes_.config();
  const double sigma = kMostAcceleration * elapsed * unseen_s_;
  constexpr double kWorth = 0.5;  // of what is known without
  if (sigma > kWorth * config.noise.unknown_velocity * to.quality.seconds_unlocked) return;
  const Eigen::Vector2d path =
      Eigen::Rotation2Dd(headingOf(from.T_odom_cam, config.forward_in_camera)) * velocity_ * elapsed;
  Eigen::Vector3d change = from.T_odom_cam * config.dvl_in_camera - to.T_odom_cam * config.dvl_in_camera;
  change.head<2>() += path;
  change.z() = 0;  // depth is measured
  StepQuality quality = to.quality;
  quality.seconds_unlocked = sigma / config.noise.unknown_velocity;
  (void)keyframes_.addFactor(stepFactor(from.node, to.node, from.T_odom_cam,
                                        SE3(to.T_odom_cam.rotation(), to.T_odom_cam.translation() + change),
                                        config.dvl_in_camera, quality, config.noise));
}

// Of the steps before the newest whose visual odometry was rejected.
void VelocityGate::rejectDvlInstead() {
  for (int k = keyframes_.next() - 2; rejected_links_ > 0 && keyframes_.has(k); --k, --rejected_links_) {
    Keyframe& keyframe = keyframes_[k];
    keyframe.link_rejected = false;
    keyframe.dvl_rejected = true;
    ++contradictions_;
    keyframes_.weigh(keyframe);
  }
  rejected_links_ = 0;
}

void VelocityGate::reset() {
  contradictions_ = rejected_links_ = agreements_ = 0;
  keyframes_.counters().dvl_rejected = false;
}

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
  turns.compass_sigma = std::numbers::sqrt2 * config.noise.heading;
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
    turns.visual_sigma = hypotenuse(
        std::sqrt(std::max(0.0, down.dot(visual_.link.covariance.bottomRightCorner<3, 3>() * down))),
        kOfTurn * turns.visual);
  }
  return turns;
}

void StepGate::addGyro(const Keyframe& from, const Keyframe& to, const StepTurns& turns) {
  if (!turns.has_gyro) return;
  // A compass that jumped takes roll and pitch with it; what is left of them then need not be precise.
  constexpr double kOfTilt = 10;  // standard deviations of a reading
  const double turn = wrapAngle(turns.gyro - heading_.gyroBias() * turns.seconds);
  (void)keyframes_.addFactor(gyroFactor(from.node, to.node, from.T_odom_cam, to.T_odom_cam,
                                        turn - turns.compass, heading_.gyroSigma(turns),
                                        kOfTilt * keyframes_.config().noise.tilt));
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
               sigma = hypotenuse(turns.visual_sigma, 2 * noise.heading,
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

#include "recon/navigation/gating/velocity_gate.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr double kYawUnjudged = 1.0;  // variance of a step's yaw, which HeadingGate judges [rad^2]
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
               place = std::hypot(stepSigma(path, to.quality, noise), kMeanTurn * contradiction * path);
  const Matrix6d at_dvl = perturbationAt(config.dvl_in_camera);
  const SE3 T_odom_seen = from.T_odom_cam * T_a_b;
  // Nav's axes, in which depth and yaw are, seen from the camera, however that is mounted.
  const Eigen::Matrix3d R = T_odom_seen.matrix3();
  const double depth = std::hypot(noise.depth, to.quality.pressure_sigma),
               vertical = std::hypot(place, 2 * depth), tilt = 2 * noise.tilt;
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
  if (!visual.linked) {
    if (locked && !counters.dvl_rejected) velocity_ = by_reckoning;
    return;
  }
  const Eigen::Vector2d by_images = velocity(from.T_odom_cam * visual.link.T_a_b);
  const auto calibrate = [&] {
    if (locked && to.heading.visual)
      (void)dvl_.add(from.T_odom_cam, to.T_odom_cam, visual.T_a_b, visual.link.covariance, to.quality,
                     to.range);
  };
  if (agreesButForYaw(from, to, visual, 0)) {
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

}  // namespace fathom::slam

#include "sim/mission/told_rig.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

Eigen::Vector3d drawDirection(Random& random) {
  const double x = random.gauss(), y = random.gauss(), z = random.gauss();
  return Eigen::Vector3d(x, y, z).normalized();
}

double drawSign(Random& random) {
  return random.uniform() < 0.5 ? -1 : 1;
}

// Turned by `angle` about an axis and shifted by `shift`, both some way.
SE3 drawMotion(Random& random, double angle, double shift) {
  const Eigen::AngleAxisd turn(angle, drawDirection(random));
  const Eigen::Vector3d moved = shift * drawDirection(random);
  return {Eigen::Quaterniond(turn), moved};
}

// A pose that is told wrongly: its place by `shift`, its axes by `angle`, each in the frame it is told in.
SE3 told(Random& random, const SE3& pose, double angle, double shift) {
  const SE3 off = drawMotion(random, angle, shift);
  return {off.rotation() * pose.rotation(), pose.translation() + off.translation()};
}

}  // namespace

ToldRig toldRig(const CalibrationErrors& errors, const StereoRig& rig, const io::MissionConfig& mission,
                std::uint64_t seed) {
  Random random(seed, "calibration-errors");
  ToldRig out{rig, mission};
  for (Camera* camera : {&out.rig.left, &out.rig.right}) {
    const double longer = 1 + errors.focal * drawSign(random);
    camera->fx *= longer, camera->fy *= longer;
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const double off = errors.centre * camera->width;
    camera->cx += off * std::cos(angle), camera->cy += off * std::sin(angle);
    camera->k1 += errors.radial * drawSign(random);
  }
  out.rig.T_right_left = told(random, rig.T_right_left, errors.rig_angle, errors.rig_position_m);
  const SE3 turned = SE3::fromEuler(errors.rig_x, errors.rig_y, errors.rig_z, Eigen::Vector3d::Zero());
  const SE3 apart(out.rig.T_right_left.rotation(),
                  (1 + errors.baseline) * out.rig.T_right_left.translation());
  out.rig.T_right_left = turned * apart;
  for (SE3* pose : {&out.mission.T_body_cam, &out.mission.T_body_dvl, &out.mission.T_body_compass})
    *pose = told(random, *pose, errors.mounting_angle, errors.lever_arm_m);
  for (SE3* pose : {&out.mission.T_body_usbl, &out.mission.T_body_depth})
    *pose = told(random, *pose, 0, errors.lever_arm_m);
  io::MissionConfig::TimeOffsets& t = out.mission.time_offsets;
  for (double* offset : {&t.dvl, &t.compass, &t.depth}) *offset += errors.time_s * drawSign(random);
  const double cameras = errors.time_s * drawSign(random);
  t.left_camera += cameras, t.right_camera += cameras;
  return out;
}

}  // namespace fathom::sim

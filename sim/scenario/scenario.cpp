#include "sim/scenario/scenario.hpp"

#include <array>
#include <utility>

namespace fathom::sim {
namespace {

// A 7 cm stereo rig behind flat ports, calibrated in water: 42 x 34 degrees.
StereoRig defaultRig() {
  StereoRig rig;
  rig.left = {1360, 1024, 1725.4, 1723.1, 687.2, 507.9, 0.142, 0.655, 0.0021, -0.0013, 0.0};
  rig.right = {1360, 1024, 1728.9, 1726.8, 674.6, 515.3, 0.138, 0.690, -0.0012, 0.0017, 0.0};
  rig.T_right_left = SE3::fromEuler(0.0014, -0.0041, 0.0008, {-0.0702, 0.0003, -0.0009});
  return rig;
}

}  // namespace

Scenario::Scenario() : rig(defaultRig()) {
  terrain.base_depth_m = 12.0;
}

StereoRig Scenario::stereoRig() const {
  StereoRig out = rig;
  if (ports.kind == PortKind::kFlat) {
    for (const auto& [camera, port] : {std::pair(&out.left, &ports.left), {&out.right, &ports.right}}) {
      FlatPort flat = *port;
      flat.air = *camera;
      flat.normal.normalize();
      *camera = behindPort(flat);
    }
  }
  return scale == 1.0 ? out : out.scaled(scale);
}

void visitPose(KeyVisitor& keys, const char* table, SE3& pose, const char* meaning) {
  keys.enter(table, meaning);
  Eigen::Vector3d translation = pose.translation(), euler = pose.euler();
  keys.vector3("position_m", translation, "m", -20, 20, "x, y, z");
  keys.vector3("euler_rad", euler, "rad", -3.2, 3.2, "about x, y, z: R = Rz Ry Rx");
  pose = SE3::fromEuler(euler.x(), euler.y(), euler.z(), translation);
  keys.leave();
}

void visitScenario(KeyVisitor& keys, Scenario& s) {
  keys.text("name", s.name, "of the scenario");
  keys.text("description", s.description, "one line");
  keys.integer("seed", s.seed, 0, 9007199254740992,
               "of every random number; terrain.seed is the terrain's own");
  keys.utc("start_utc", s.start_utc_ns, "when the mission begins");
  keys.angle("origin_latitude_deg", s.origin.latitude, -80, 80, "of nav, WGS84");
  keys.angle("origin_longitude_deg", s.origin.longitude, -180, 180, "of nav, WGS84");
  keys.angle("magnetic_declination_deg", s.magnetic_declination, -60, 60, "east positive");
  keys.text("vehicle_name", s.vehicle_name, "in mission.toml");
  keys.integer("vehicle_id", s.vehicle_id, 0, 255, "on the acoustic link");
  keys.integer("dive_id", s.dive_id, 0, 65535, "on the acoustic link");
  keys.number("scale", s.scale, "1", 0.05, 1, "of the images' sides");
  keys.number("longest_survey_s", s.longest_survey_s, "s", 1, kLongestSurvey, "the survey is cut after this");
  visitSurvey(keys, s.plan, s.vehicle);
  visitTerrain(keys, s.terrain);
  visitOptics(keys, s.optics);
  visitFeatures(keys, s.features);
  keys.enter("rig", "the stereo cameras at full size; the right one sits to starboard");
  keys.vector3("body_position_m", s.camera_position, "m", -5, 5, "of the left camera in body");
  keys.vector3("body_euler_rad", s.camera_euler, "rad", -3.2, 3.2,
               "of the left camera in body; (0, 0, pi/2) looks down with the image's top forward");
  static constexpr std::array<const char*, 2> kPortKinds{"in_water", "flat"};
  keys.choiceOf(
      "calibrated", s.ports.kind, kPortKinds,
      "in_water: the cameras' numbers are those under water; flat: those in air, behind flat ports");
  visitRig(keys, s.rig);
  visitPorts(keys, s.ports);
  keys.leave();
  keys.enter("extrinsics", "poses of the other sensors in body (forward, starboard, down)");
  visitPose(keys, "dvl", s.T_body_dvl, "Doppler velocity log");
  visitPose(keys, "usbl", s.T_body_usbl, "acoustic transponder");
  visitPose(keys, "depth", s.T_body_depth, "pressure sensor");
  visitPose(keys, "compass", s.T_body_compass, "compass and tilt sensor");
  keys.leave();
  visitCalibrationErrors(keys, s.calibration_errors);
  visitSensors(keys, s.sensors);
}

}  // namespace fathom::sim

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "realtime/base/config_keys.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/features/feature_config.hpp"
#include "sim/sea/optics.hpp"
#include "sim/sea/terrain_config.hpp"
#include "sim/sensors/sensors.hpp"
#include "sim/vehicle/vehicle.hpp"

namespace fathom::sim {

// Windows between the cameras and the water.
enum class PortKind : std::uint8_t { kInWater, kFlat };
struct RigPorts {
  PortKind kind = PortKind::kInWater;
  FlatPort left{.distance = 0.02, .glass = 0.01}, right{.distance = 0.02, .glass = 0.01};
};

// Errors of the calibration in mission.toml and stereo.calib against the true one, which is in truth/. Their
// directions and signs are drawn at random unless noted.
struct CalibrationErrors {
  double focal = 0;                        // of each camera's focal lengths, relative
  double centre = 0;                       // of each principal point, of the image's width
  double radial = 0;                       // of each camera's k1
  double rig_angle = 0;                    // between the cameras, about a random axis [rad]
  double rig_x = 0, rig_y = 0, rig_z = 0;  // added, not random, about the right camera's axes [rad]
  double baseline = 0;                     // relative, not random
  double rig_position_m = 0;               // of the right camera
  double mounting_angle = 0;               // of cameras, DVL and compass in body [rad]
  double lever_arm_m = 0;                  // of each sensor in body
  double time_s = 0;                       // of the stamps of DVL, compass, depth, and of both cameras alike
};

// A mission to simulate; its files depend on nothing else.
constexpr double kLongestSurvey = 36000;  // that a scenario may ask for [s]
struct Scenario {
  std::filesystem::path file;  // it was read from
  std::string name = "default";
  std::string description = "Every key with its default";
  std::int64_t seed = 1;
  std::int64_t start_utc_ns = 1772330400000000000;                      // 2026-03-01T02:00:00Z
  Geodetic origin{degreesToRadians(-23.44), degreesToRadians(151.91)};  // Heron Reef, Great Barrier Reef
  double magnetic_declination = degreesToRadians(10.4);                 // [rad]
  std::string vehicle_name = "sirius";
  int vehicle_id = 1, dive_id = 1;
  double scale = 1.0;              // of the images' sides
  double longest_survey_s = 7200;  // the survey is cut after this [s]

  TerrainConfig terrain;
  OpticsConfig optics;
  SimulatedFeatureConfig features;  // for missions without pictures
  StereoRig rig;                    // at full size
  RigPorts ports;
  CalibrationErrors calibration_errors;
  Eigen::Vector3d camera_position{0.42, -0.03, 0.28};     // of the left camera in body [m]
  Eigen::Vector3d camera_euler{0.0105, -0.0157, 1.5847};  // of T_body_cam [rad]
  SurveyPlan plan;
  VehicleConfig vehicle;
  SensorsConfig sensors;
  SE3 T_body_dvl = SE3::fromEuler(0.004, -0.006, 0.012, {-0.35, 0.0, 0.22});
  SE3 T_body_usbl = SE3::fromEuler(0, 0, 0, {0.1, 0.0, -0.45});
  SE3 T_body_depth = SE3::fromEuler(0, 0, 0, {0.2, 0.1, -0.1});
  SE3 T_body_compass = SE3::fromEuler(0.003, 0.005, -0.009, {0.6, 0.05, -0.2});

  Scenario();
  // The rig at the images' scale, behind its ports.
  [[nodiscard]] StereoRig stereoRig() const;
  [[nodiscard]] SE3 T_body_cam() const {
    return SE3::fromEuler(camera_euler.x(), camera_euler.y(), camera_euler.z(), camera_position);
  }
};

// Every key of a scenario, in the file's order.
void visitScenario(KeyVisitor& keys, Scenario& scenario);

// The parts of visitScenario().
void visitTerrain(KeyVisitor& keys, TerrainConfig& terrain);
void visitOptics(KeyVisitor& keys, OpticsConfig& optics);
void visitFeatures(KeyVisitor& keys, SimulatedFeatureConfig& features);
void visitRig(KeyVisitor& keys, StereoRig& rig);
void visitPorts(KeyVisitor& keys, RigPorts& ports);
void visitCalibrationErrors(KeyVisitor& keys, CalibrationErrors& errors);
void visitSurvey(KeyVisitor& keys, SurveyPlan& plan, VehicleConfig& vehicle);
void visitSensors(KeyVisitor& keys, SensorsConfig& sensors);
void visitPose(KeyVisitor& keys, const char* table, SE3& pose, const char* meaning);

}  // namespace fathom::sim

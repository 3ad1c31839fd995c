#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "firmware_if/files/sensor_log.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "sim/scenario/degrees.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sensors/waves.hpp"
#include "sim/vehicle/trajectory.hpp"

namespace fathom::sim {

// Errors and rates of the sensors, as the table of the AUV Sirius gives them (Johnson-Roberson et al. 2010,
// table 1).

// From and to a time since the mission's start [s].
struct Spell {
  double from_s = 0, to_s = 0;
  [[nodiscard]] bool holds(double time_s) const { return time_s >= from_s && time_s < to_s; }
};

struct DvlConfig {
  double rate_hz = 5.0;
  double velocity_sigma_mps = 0.002;             // white, each axis
  double scale_error = 0.002;                    // largest; drawn once a dive from +- this
  double range_sigma_m = 0.01;                   // each beam
  double dropout_probability = 0.005;            // that an ensemble begins a dropout
  double dropout_length = 3.0;                   // mean, in ensembles
  double beam_angle = degrees(30);               // off the axis [rad]
  double min_range_m = 0.3, max_range_m = 30.0;  // of bottom lock, along a beam
  double assumed_sound_speed_mps = 1500.0;       // what the instrument computes with
  double latency_s = 0.12;
  double velocity_sigma_per_m = 0;  // more noise of each axis, by the altitude [1/s]
  int dead_beam = 0;                // 1 to 4; 0: none
  double fish_probability = 0;      // that a beam of an ensemble ends on something in the water
  double steepest = degrees(90);    // incidence on the seafloor beyond which a beam is lost [rad]
  double bubble_depth_m = 0;        // above it nothing is heard
  double current_north_mps = 0, current_east_mps = 0;  // of the water, which a false bottom drifts with
  std::vector<Spell> outages;                          // silent: no ensembles at all
  std::vector<Spell> stuck;                            // the last good ensemble over and over
  std::vector<Spell> false_bottom;  // locked to a layer half way down instead of the seafloor
};

struct CompassJump {
  double at_s = 0;            // since the mission's start
  double turn = degrees(20);  // of the heading from then on [rad]
};

// What something magnetic on the seafloor does to headings within a few of its radii: as a dipole's field
// falls off, turn / (1 + (d / radius)^2)^(3/2) at the horizontal distance d.
struct MagneticAnomaly {
  double north_m = 0, east_m = 0;  // in nav
  double radius_m = 3;
  double turn = degrees(20);  // of the heading above it [rad]
};

struct CompassConfig {
  double rate_hz = 10.0;
  double deviation = degrees(1.2);         // amplitude of the hard-iron deviation over the heading [rad]
  double drift_sigma = degrees(0.3);       // slow change of the deviation [rad]
  double heading_sigma = degrees(0.3);     // white [rad]
  double tilt_bias_sigma = degrees(0.17);  // of roll and pitch, drawn once a dive [rad]
  double tilt_sigma = degrees(0.1);        // white [rad]
  double latency_s = 0.03;
  double soft_iron = 0;            // amplitude of the deviation twice over the heading [rad]
  double lag_s = 0;                // of all three angles behind the hull
  double acceleration_share = 0;   // of the hull's acceleration that is taken for gravity
  std::vector<CompassJump> jumps;  // something magnetic came near: it adds up
  std::vector<MagneticAnomaly> anomalies;
};

// Rates about the compass's axes, as a tactical fibre-optic gyro gives them.
struct GyroConfig {
  double rate_hz = 0;                         // 0: there is none
  double angle_random_walk = degrees(0.002);  // white [rad/s^(1/2)]
  double bias_sigma = degrees(3e-4);          // of each axis, drawn once a dive: 1 deg/h [rad/s]
  double bias_walk = degrees(5e-6);           // its random walk [rad/s^(3/2)]
  double latency_s = 0.02;
};

struct DepthSensorConfig {
  double rate_hz = 5.0;
  double scale_error = 1e-4;  // of the depth, standard deviation, drawn once a dive (0.01 %)
  double sigma_m = 0.003;     // white
  double latency_s = 0.05;
};

// Fixes that are wrong alike for a while.
struct UsblEcho : Spell {
  double north_m = 0, east_m = 0;  // added to the fix; another target: where it is, in nav
};

struct UsblConfig {
  double period_s = 10.0;
  double range_sigma_m = 0.2;
  double angle_sigma = degrees(0.25);               // bearing and elevation [rad]
  double ship_north_m = 25.0, ship_east_m = -15.0;  // transceiver in nav
  double ship_depth_m = 2.0;
  double delay_s = 3.0;  // mean, from ping to arrival on board
  double outlier_probability = 0.04;
  double outlier_m = 12.0;  // size of an outlier (reflections)
  // What the ship does not know: how its transceiver is turned [rad], and where its antenna is.
  double misalignment = 0, offset_north_m = 0, offset_east_m = 0;
  double range_sigma_per_m = 0;                // more noise of the range, by the range
  double bending = 0;                          // of the ray, downwards [rad]
  double heading_wobble = 0;                   // of the ship's compass: slow, standard deviation [rad]
  double ship_circle_m = 0, ship_lap_s = 600;  // the ship sails a circle about its place; 0: it lies still
  std::vector<UsblEcho> multipath, wrong_targets;
};

struct GpsConfig {
  double rate_hz = 1.0;
  double drift_sigma_m = 0.8;  // slow, north and east each
  double sigma_m = 0.4;        // white, north and east each
  double latency_s = 0.2;
};

struct WaterSensorConfig {
  double rate_hz = 1.0;
  double temperature_c = 24.0;
  double salinity_psu = 35.4;
  double temperature_sigma_c = 0.003;
  double conductivity_sigma = 0.0003;  // [S/m]
  double chlorophyll_ug_l = 0.35;
  double cdom_ppb = 0.9;
  double turbidity = 0.0012;            // optical backscatter [1/m/sr]
  double optics_relative_sigma = 0.05;  // of the three
  double latency_s = 0.3;
};

// The main battery of Sirius (1.5 kWh of lithium cells): the electronics draw `hotel_w`, the thrusters the
// cube of the speed through still water. The voltage falls in proportion to the charge, and with the current.
struct BatteryConfig {
  double rate_hz = 0.2;
  double capacity_wh = 1500;
  double start_charge = 0.95;
  double hotel_w = 150;
  double thrust_w_per_m3ps3 = 320;  // 40 W at 0.5 m/s
  double full_v = 50.4, empty_v = 42.0;
  double resistance_ohm = 0.08;
  double latency_s = 0.1;
};

struct CameraClockConfig {
  double rate_hz = 2.0;
  double exposure_s = 0.004;
  double left_offset_s = 0.012, right_offset_s = 0.009;  // clock minus UTC at the mission's start
  double left_drift = 50e-6, right_drift = -50e-6;       // [s/s]
  double known_to_s = 0.0005;  // largest error of the offsets that mission.toml tells
  double latency_s = 0.15;
  double right_delay_s = 0;  // of the right shutter, which nobody tells
};

// What the computer that takes the samples of DVL, compass and depth does to them.
struct ArrivalConfig {
  double jitter_s = 0;        // mean of a delay that differs from sample to sample
  double batch_s = 0;         // samples are handed over in batches so far apart; 0: one by one
  double stamp_jitter_s = 0;  // standard deviation of the stamps themselves
};

struct TideConfig {
  double amplitude_m = 0.0;    // 0: none
  double period_s = 44714.16;  // the principal lunar tide, M2
  double phase = 0.0;          // [rad]
  int in_mission = 1;          // 1: mission.toml predicts it; 0: its tide_model is "none"
};
// Height of the sea over nav's zero [m].
[[nodiscard]] double tideHeight(const TideConfig& tide, double time_s);

struct SensorsConfig {
  DvlConfig dvl;
  CompassConfig compass;
  GyroConfig gyro;
  DepthSensorConfig depth;
  UsblConfig usbl;
  GpsConfig gps;
  WaterSensorConfig water;
  BatteryConfig battery;
  CameraClockConfig cameras;
  TideConfig tide;
  WavesConfig waves;
  ArrivalConfig arrival;
};

// Patches of plankton and of stirred-up sediment that the vehicle passes in a minute or more; 0 at the mean.
struct WaterPatches {
  explicit WaterPatches(Random& random);
  SmoothNoise plankton, sediment;
};

// What the sensors are exposed to.
struct SensorWorld {
  const Trajectory& trajectory;
  // Distance [m] from a point along a unit direction to the seafloor; std::nullopt if the ray meets none.
  std::function<std::optional<double>(const Eigen::Vector3d&, const Eigen::Vector3d&)> cast_ray;
  Geodetic origin;
  std::int64_t start_utc_ns = 0;
  double magnetic_declination = 0;  // [rad]
  SE3 T_body_dvl, T_body_usbl, T_body_depth, T_body_compass;
  std::uint64_t seed = 1;

  [[nodiscard]] std::int64_t utcNs(double time_s) const;
  // Of the water under a place [m].
  [[nodiscard]] double waterDepthAt(const Eigen::Vector2d& place) const;
  // Their wavelengths are those of the water where the mission begins.
  [[nodiscard]] Waves waves(const WavesConfig& config) const;
};

// One exposure of the pair.
struct Exposure {
  double time_s = 0;                                   // true time since the mission's start
  std::int64_t left_stamp_ns = 0, right_stamp_ns = 0;  // by each camera's own clock
  double over_usual = 1;                               // how long, as the log tells it too
};

// Unit vectors of the four Janus beams in the DVL frame: 45 degrees to starboard of forward, then clockwise
// seen from above.
[[nodiscard]] std::array<Eigen::Vector3d, 4> dvlBeams(double beam_angle);

// Each appends its samples over the whole trajectory, in the order of their own time.
using LoggedSamples = std::vector<io::LoggedSample>;
void simulateDvl(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateCompass(const SensorWorld& world, const CompassConfig& config, LoggedSamples& samples);
void simulateGyro(const SensorWorld& world, const GyroConfig& config, LoggedSamples& samples);
void simulateDepth(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateUsbl(const SensorWorld& world, const UsblConfig& config, LoggedSamples& samples);
void simulateGps(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateWater(const SensorWorld& world, const WaterSensorConfig& config, LoggedSamples& samples);
void simulateBattery(const SensorWorld& world, const BatteryConfig& config, LoggedSamples& samples);

// Exposures from the survey's begin to its end; both cameras are triggered at the same instant (the right
// shutter opens right_delay_s later).
[[nodiscard]] std::vector<Exposure> simulateExposures(const SensorWorld& world,
                                                      const CameraClockConfig& config);

// Everything, image events included, in the order of arrival.
[[nodiscard]] LoggedSamples simulateSensors(const SensorWorld& world, const SensorsConfig& config,
                                            const std::vector<Exposure>& exposures);

}  // namespace fathom::sim

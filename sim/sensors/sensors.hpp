#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "sim/scenario/random.hpp"
#include "sim/vehicle/vehicle.hpp"

namespace fathom::sim {

struct WavesConfig {
  double height_m = 0.0;                    // significant: four standard deviations of the surface; 0: none
  double period_s = 8.0;                    // of the spectrum's peak
  double towards = degreesToRadians(90);    // where they run to, from north to east [rad]
  double spreading = degreesToRadians(15);  // standard deviation of the directions about it [rad]
};

// Surface waves of a sea: linear (Airy) theory in water of finite depth (Dean and Dalrymple 1991, ch. 3),
//   eta = sum a cos(omega t - k . x + phase),   omega^2 = g k tanh(k h),
// with components of equal variance: a JONSWAP spectrum (Hasselmann et al. 1973; peak enhancement 3.3) is
// divided into parts of equal variance, and each frequency is drawn from its part. x: north and east in nav
// [m]; t: since the mission's start [s]. Draws from the stream "waves".
class Waves {
 public:
  // `water_depth_m`: of the dispersion relation.
  Waves(const WavesConfig& config, std::uint64_t seed, double water_depth_m);

  [[nodiscard]] bool calm() const { return components_.empty(); }
  // Height of the surface over that of the still sea [m].
  [[nodiscard]] double heightAt(const Eigen::Vector2d& place, double time_s) const;
  // Dynamic pressure at a depth below the still sea, as a height of water [m]: each component times
  // cosh(k (h - depth)) / cosh(k h), h the water's depth there.
  [[nodiscard]] double pressureAt(const Eigen::Vector3d& place, double water_depth_m, double time_s) const;
  // Displacement of the surface's water from its place at rest, north and east [m].
  [[nodiscard]] Eigen::Vector2d shiftAt(const Eigen::Vector2d& place, double time_s) const;

 private:
  struct Component {
    double amplitude, rate, phase;  // [m], [rad/s], [rad]
    Eigen::Vector2d number;         // k [rad/m]
    [[nodiscard]] double phaseAt(const Eigen::Vector2d& place, double time_s) const {
      return rate * time_s - number.dot(place) + phase;
    }
  };
  double water_depth_m_;
  std::vector<Component> components_;
};

// Rates and errors of the sensors; the defaults are those of the AUV Sirius (Johnson-Roberson et al. 2010,
// table 1).

// An interval of mission time [s].
struct TimeSpan {
  double from_s = 0, to_s = 0;
  [[nodiscard]] bool contains(double time_s) const { return time_s >= from_s && time_s < to_s; }
};

struct SimulatedDvlConfig {
  double rate_hz = 5.0;
  double velocity_sigma_mps = 0.002;             // white, each axis
  double scale_error = 0.002;                    // largest; drawn once for each dive from +- this
  double range_sigma_m = 0.01;                   // each beam
  double dropout_probability = 0.005;            // that an ensemble begins a dropout
  double dropout_length = 3.0;                   // mean, in ensembles
  double beam_angle = degreesToRadians(30);      // off the axis [rad]
  double min_range_m = 0.3, max_range_m = 30.0;  // of bottom lock, along a beam
  double assumed_sound_speed_mps = 1500.0;       // used by the instrument
  double latency_s = 0.12;
  double velocity_sigma_per_m = 0;         // noise of each axis added in proportion to the altitude [1/s]
  int dead_beam = 0;                       // 1 to 4; 0: none
  double fish_probability = 0;             // that a beam of an ensemble is reflected in the water
  double steepest = degreesToRadians(90);  // incidence on the seafloor beyond which a beam is lost [rad]
  double bubble_depth_m = 0;               // no bottom lock above it
  double current_north_mps = 0, current_east_mps = 0;  // of the water and of a false bottom
  std::vector<TimeSpan> outages;                       // without ensembles
  std::vector<TimeSpan> stuck;                         // the last good ensemble is repeated
  std::vector<TimeSpan> false_bottom;                  // locked to a layer at half the range
};

struct CompassJump {
  double at_s = 0;                     // since the mission's start
  double turn = degreesToRadians(20);  // of the heading from then on [rad]
};

// Heading error near a magnetic object, with the decay of a dipole's field: turn (radius / d)^3 at the
// distance d from it, of half the radius at least.
struct MagneticAnomaly {
  double north_m = 0, east_m = 0,
         depth_m = 0;  // in nav; depth 0: a radius below the compass, however deep that is
  double radius_m = 3;
  double turn = degreesToRadians(20);  // of the heading a radius above it [rad]
};

struct CompassConfig {
  double rate_hz = 10.0;
  double deviation = degreesToRadians(1.2);    // amplitude of the hard-iron deviation over the heading [rad]
  double drift_sigma = degreesToRadians(0.3);  // slow change of the deviation [rad]
  double heading_sigma = degreesToRadians(0.3);     // white [rad]
  double tilt_bias_sigma = degreesToRadians(0.17);  // of roll and pitch, drawn once for each dive [rad]
  double tilt_sigma = degreesToRadians(0.1);        // white [rad]
  double latency_s = 0.03;
  double soft_iron = 0;            // amplitude of the deviation twice over the heading [rad]
  double lag_s = 0;                // of all three angles behind the hull
  double acceleration_share = 0;   // of the hull's acceleration that is taken for gravity
  std::vector<CompassJump> jumps;  // their heading errors add up
  std::vector<MagneticAnomaly> anomalies;
};

// Rates about the compass's axes, as a tactical fibre-optic gyro gives them.
struct GyroConfig {
  double rate_hz = 0;                                  // 0: there is none
  double angle_random_walk = degreesToRadians(0.002);  // white [rad/s^(1/2)]
  double bias_sigma = degreesToRadians(3e-4);  // of each axis, drawn once for each dive: 1 deg/h [rad/s]
  double bias_walk = degreesToRadians(5e-6);   // its random walk [rad/s^(3/2)]
  double latency_s = 0.02;
};

struct DepthSensorConfig {
  double rate_hz = 5.0;
  double scale_error = 1e-4;  // of the depth, standard deviation, drawn once for each dive (0.01 %)
  double sigma_m = 0.003;     // white
  double latency_s = 0.05;
};

// A burst of correlated fix errors.
struct UsblErrorBurst : TimeSpan {
  double north_m = 0, east_m = 0;  // added to the fix; of a wrong target: its position in nav
};

struct UsblConfig {
  double period_s = 10.0;
  double range_sigma_m = 0.2;
  double angle_sigma = degreesToRadians(0.25);      // bearing and elevation [rad]
  double ship_north_m = 25.0, ship_east_m = -15.0;  // transceiver in nav
  double ship_depth_m = 2.0;
  double delay_s = 3.0;  // mean, from ping to arrival on board
  double outlier_probability = 0.04;
  double outlier_m = 12.0;  // mean size of an outlier (reflections)
  // Unknown to the ship: rotation of its transceiver [rad], and offset of its position [m].
  double misalignment = 0, offset_north_m = 0, offset_east_m = 0;
  double range_sigma_per_m = 0;                // range noise added in proportion to the range
  double bending = 0;                          // of the ray, downwards [rad]
  double heading_wobble = 0;                   // of the ship's compass: slow, standard deviation [rad]
  double ship_circle_m = 0, ship_lap_s = 600;  // circle of the ship about its place; 0: it is at rest
  std::vector<UsblErrorBurst> multipath, wrong_targets;
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
  double known_to_s = 0.0005;                            // largest error of the offsets in mission.toml
  double latency_s = 0.15;
  double right_delay_s = 0;  // of the right shutter, not stated anywhere
};

// Delays and stamp errors by the computer that receives DVL, compass and depth.
struct ArrivalConfig {
  double jitter_s = 0;        // mean of a delay that differs from sample to sample
  double batch_s = 0;         // period of the batches in which samples arrive; 0: one by one
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
  SimulatedDvlConfig dvl;
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

// Patches of plankton and sediment along the track, relative to their means, with periods of minutes.
struct WaterPatches {
  explicit WaterPatches(Random& random);
  SmoothNoise plankton, sediment;
};

// The simulated environment of the sensors.
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
  // Depth of the water at a place [m].
  [[nodiscard]] double waterDepthAt(const Eigen::Vector2d& place) const;
  // Waves with the wavelengths of the water depth at the mission's start.
  [[nodiscard]] Waves waves(const WavesConfig& config) const;
};

// One exposure of the pair.
struct Exposure {
  double time_s = 0;                                   // true time since the mission's start
  std::int64_t left_stamp_ns = 0, right_stamp_ns = 0;  // by each camera's own clock
  double over_usual = 1;                               // exposure time over its usual, also in the log
};

// Unit vectors of the four Janus beams in the DVL frame: 45 degrees to starboard of forward, then clockwise
// seen from above.
[[nodiscard]] std::array<Eigen::Vector3d, 4> dvlBeams(double beam_angle);

// Each function appends its samples of the whole trajectory in the order of their stamps.
using LoggedSamples = std::vector<io::LoggedSample>;
void simulateDvl(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateCompass(const SensorWorld& world, const CompassConfig& config, LoggedSamples& samples);
void simulateGyro(const SensorWorld& world, const GyroConfig& config, LoggedSamples& samples);
void simulateDepth(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateUsbl(const SensorWorld& world, const UsblConfig& config, LoggedSamples& samples);
void simulateGps(const SensorWorld& world, const SensorsConfig& config, LoggedSamples& samples);
void simulateWater(const SensorWorld& world, const WaterSensorConfig& config, LoggedSamples& samples);
void simulateBattery(const SensorWorld& world, const BatteryConfig& config, LoggedSamples& samples);

// Speed of sound in sea water [m/s]: Mackenzie (1981), for 2 to 30 deg C, 25 to 40 psu, down to 8,000 m.
[[nodiscard]] double soundSpeed(double temperature_c, double salinity_psu, double depth_m);
// Conductivity [S/m] of sea water of a practical salinity at atmospheric pressure: the practical salinity
// scale of 1978 (UNESCO technical paper 44), solved for conductivity. The effect of pressure is below 0.05 %
// at 50 m.
[[nodiscard]] double conductivity(double temperature_c, double salinity_psu);
// Practical salinity [psu] from conductivity [S/m].
[[nodiscard]] double practicalSalinity(double temperature_c, double conductivity_s_per_m);

// Exposures from the survey's begin to its end; both cameras are triggered at the same instant (the right
// shutter opens right_delay_s later).
[[nodiscard]] std::vector<Exposure> simulateExposures(const SensorWorld& world,
                                                      const CameraClockConfig& config);

// All samples and image events in the order of arrival.
[[nodiscard]] LoggedSamples simulateSensors(const SensorWorld& world, const SensorsConfig& config,
                                            const std::vector<Exposure>& exposures);

}  // namespace fathom::sim

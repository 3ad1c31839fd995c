#include "sim/campaign/perturbations.hpp"

namespace fathom::sim {
namespace {

constexpr double kAllDive = 1e5;  // [s]

constexpr Perturbation kTable[] = {
    {"cameras turned against each other",
     "deg",
     {0.1, 0.3, 1, 3},
     true,
     [](Scenario& s, double v) { s.calibration_errors.rig_angle = degrees(v); }},
    {"focal lengths off",
     "%",
     {0.1, 0.5, 2, 5},
     true,
     [](Scenario& s, double v) { s.calibration_errors.focal = v / 100; }},
    {"sensors' mounting off",
     "deg",
     {0.2, 1, 3, 10},
     true,
     [](Scenario& s, double v) { s.calibration_errors.mounting_angle = degrees(v); }},
    {"lever arms off",
     "m",
     {0.005, 0.02, 0.1, 0.5},
     true,
     [](Scenario& s, double v) { s.calibration_errors.lever_arm_m = v; }},
    {"stamps off",
     "s",
     {0.005, 0.03, 0.1, 0.5},
     true,
     [](Scenario& s, double v) { s.calibration_errors.time_s = v; }},
    {"right shutter late",
     "s",
     {0.001, 0.004, 0.02, 0.05},
     true,
     [](Scenario& s, double v) { s.sensors.cameras.right_delay_s = v; }},
    {"marine snow",
     "1/m3",
     {500, 3000, 10000, 50000},
     true,
     [](Scenario& s, double v) { s.optics.water.snow_per_m3 = v; }},
    {"water more turbid",
     "times",
     {1.5, 3, 6, 12},
     true,
     [](Scenario& s, double v) {
       for (double& b : s.optics.water.scattering_per_m) b *= v;
     }},
    {"patches of sediment",
     "times",
     {0.5, 1.5, 4, 10},
     true,
     [](Scenario& s, double v) { s.optics.water.patches = v; }},
    {"silt raised",
     "times",
     {2, 5, 15, 50},
     true,
     [](Scenario& s, double v) {
       s.optics.water.silt = {{60, v, 20}};
     }},
    {"forward scatter",
     "1/m",
     {0.05, 0.2, 0.6, 1.5},
     true,
     [](Scenario& s, double v) { s.optics.water.forward_per_m = v; }},
    {"sun with caustics",
     "1",
     {0.02, 0.08, 0.3, 1},
     true,
     [](Scenario& s, double v) { s.optics.daylight.irradiance = v, s.optics.daylight.caustics = 0.6; }},
    {"strobes vary",
     "%",
     {5, 15, 40, 80},
     true,
     [](Scenario& s, double v) { s.optics.flash_sigma = v / 100; }},
    {"a strobe misfires",
     "%",
     {1, 5, 20, 60},
     true,
     [](Scenario& s, double v) { s.optics.misfire_probability = v / 100; }},
    {"pairs dark",
     "%",
     {1, 5, 20, 50},
     true,
     [](Scenario& s, double v) { s.optics.dark_probability = v / 100; }},
    {"light too weak",
     "times",
     {0.5, 0.2, 0.05, 0.01},
     true,
     [](Scenario& s, double v) { s.optics.sensor.exposure *= v; }},
    {"image gathers light",
     "s",
     {0.002, 0.008, 0.03, 0.1},
     true,
     [](Scenario& s, double v) { s.optics.sensor.open_s = v; }},
    {"out of focus (aperture)",
     "mm",
     {3, 10, 25, 50},
     true,
     [](Scenario& s, double v) { s.optics.sensor.aperture_mm = v, s.optics.sensor.focus_m = 1; }},
    {"fish",
     "1",
     {3, 15, 60, 300},
     true,
     [](Scenario& s, double v) { s.terrain.fish = static_cast<int>(v); }},
    {"sea grass that sways",
     "1/m2",
     {0.5, 3, 15, 60},
     true,
     [](Scenario& s, double v) { s.terrain.swaying_density_per_m2 = v; }},
    {"ground without texture",
     "1",
     {0.1, 0.05, 0.02, 0.005},
     true,
     [](Scenario& s, double v) {
       s.terrain.detail_contrast = v, s.terrain.roughness_m = 0.1 * v, s.terrain.ripples.height_m = 0.1 * v;
       s.terrain.rubble.density_per_m2 = s.terrain.boulders.density_per_m2 = s.terrain.corals.density_per_m2 =
           0;
     }},
    {"magnetic anomaly",
     "deg",
     {3, 10, 30, 90},
     false,
     [](Scenario& s, double v) {
       s.sensors.compass.anomalies = {{0.5, 0.5, 2.5, degrees(v)}};
     }},
    {"compass jumps",
     "deg",
     {3, 10, 30, 90},
     false,
     [](Scenario& s, double v) {
       s.sensors.compass.jumps = {{80, degrees(v)}};
     }},
    {"soft iron",
     "deg",
     {1, 3, 10, 30},
     false,
     [](Scenario& s, double v) { s.sensors.compass.soft_iron = degrees(v); }},
    {"compass lags",
     "s",
     {0.1, 0.3, 1, 5},
     false,
     [](Scenario& s, double v) { s.sensors.compass.lag_s = v; }},
    {"DVL silent",
     "s",
     {5, 20, 60, 300},
     false,
     [](Scenario& s, double v) {
       s.sensors.dvl.outages = {{70, 70 + v}};
     }},
    {"DVL stuck",
     "s",
     {5, 20, 60, 300},
     false,
     [](Scenario& s, double v) {
       s.sensors.dvl.stuck = {{70, 70 + v}};
     }},
    {"DVL on a false bottom",
     "s",
     {5, 20, 60, 300},
     false,
     [](Scenario& s, double v) {
       s.sensors.dvl.false_bottom = {{70, 70 + v}};
       s.sensors.dvl.current_east_mps = 0.2;
     }},
    {"fish in the DVL's beams",
     "%",
     {1, 5, 20, 60},
     false,
     [](Scenario& s, double v) { s.sensors.dvl.fish_probability = v / 100; }},
    {"DVL noisier",
     "times",
     {3, 10, 30, 100},
     false,
     [](Scenario& s, double v) { s.sensors.dvl.velocity_sigma_mps *= v; }},
    {"USBL multipath",
     "m",
     {2, 8, 30, 200},
     false,
     [](Scenario& s, double v) {
       s.sensors.usbl.multipath = {{80, kAllDive, v, -0.5 * v}};
     }},
    {"ship's compass wanders",
     "deg",
     {1, 3, 10, 20},
     false,
     [](Scenario& s, double v) { s.sensors.usbl.heading_wobble = degrees(v); }},
    {"samples late and in batches",
     "s",
     {0.05, 0.2, 1, 3},
     false,
     [](Scenario& s, double v) {
       s.sensors.arrival = {.jitter_s = 0.5 * v, .batch_s = v, .stamp_jitter_s = 0};
     }},
    {"stamps jitter",
     "s",
     {0.005, 0.02, 0.1, 0.5},
     false,
     [](Scenario& s, double v) { s.sensors.arrival.stamp_jitter_s = v; }},
    {"something hits the hull",
     "m",
     {0.05, 0.2, 0.6, 2},
     false,
     [](Scenario& s, double v) {
       s.vehicle.collisions = {{80, v, degrees(60 * v), 4}};
     }},
    {"hovers",
     "s",
     {10, 30, 60, 120},
     false,
     [](Scenario& s, double v) {
       s.vehicle.hovers = {{80, v}};
     }},
};

}  // namespace

std::span<const Perturbation> perturbations() {
  return kTable;
}

}  // namespace fathom::sim

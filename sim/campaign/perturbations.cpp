#include "sim/campaign/perturbations.hpp"

#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

constexpr double kAllDive = 1e5;  // [s]

constexpr bool kPictures = true, kFeatures = false;  // of the dive

std::vector<Perturbation> makePerturbations() {
  std::vector<Perturbation> all;
  const auto add = [&](const char* name, const char* unit, std::array<double, Perturbation::kLevels> levels,
                       bool pictures, void (*disturb)(Scenario&, double)) {
    all.push_back({name, unit, levels, pictures, disturb});
  };
  add("cameras turned against each other", "deg", {0.1, 0.3, 1, 3}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.rig_angle = degreesToRadians(v); });
  add("focal lengths off", "%", {0.1, 0.5, 2, 5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.focal = v / 100; });
  add("sensors' mounting off", "deg", {0.2, 1, 3, 10}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.mounting_angle = degreesToRadians(v); });
  add("lever arms off", "m", {0.005, 0.02, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.lever_arm_m = v; });
  add("stamps off", "s", {0.005, 0.03, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v) { s.calibration_errors.time_s = v; });
  add("right shutter late", "s", {0.001, 0.004, 0.02, 0.05}, kPictures,
      [](Scenario& s, double v) { s.sensors.cameras.right_delay_s = v; });
  add("marine snow", "1/m3", {500, 3000, 10000, 50000}, kPictures,
      [](Scenario& s, double v) { s.optics.water.snow_per_m3 = v; });
  add("water more turbid", "times", {1.5, 3, 6, 12}, kPictures, [](Scenario& s, double v) {
    for (double& b : s.optics.water.scattering_per_m) b *= v;
  });
  add("patches of sediment", "times", {0.5, 1.5, 4, 10}, kPictures,
      [](Scenario& s, double v) { s.optics.water.patches = v; });
  add("silt raised", "times", {2, 5, 15, 50}, kPictures, [](Scenario& s, double v) {
    s.optics.water.silt = {{60, v, 20}};
  });
  add("forward scatter", "1/m", {0.05, 0.2, 0.6, 1.5}, kPictures,
      [](Scenario& s, double v) { s.optics.water.forward_per_m = v; });
  add("sun with caustics", "1", {0.02, 0.08, 0.3, 1}, kPictures,
      [](Scenario& s, double v) { s.optics.daylight.irradiance = v, s.optics.daylight.caustics = 0.6; });
  add("strobes vary", "%", {5, 15, 40, 80}, kPictures,
      [](Scenario& s, double v) { s.optics.flash_sigma = v / 100; });
  add("a strobe misfires", "%", {1, 5, 20, 60}, kPictures,
      [](Scenario& s, double v) { s.optics.misfire_probability = v / 100; });
  add("pairs dark", "%", {1, 5, 20, 50}, kPictures,
      [](Scenario& s, double v) { s.optics.dark_probability = v / 100; });
  add("light too weak", "times", {0.5, 0.2, 0.05, 0.01}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.exposure *= v; });
  add("motion blur", "s", {0.002, 0.008, 0.03, 0.1}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.open_s = v; });
  add("out of focus (aperture)", "mm", {3, 10, 25, 50}, kPictures,
      [](Scenario& s, double v) { s.optics.sensor.aperture_mm = v, s.optics.sensor.focus_m = 1; });
  add("fish", "1", {3, 15, 60, 300}, kPictures,
      [](Scenario& s, double v) { s.terrain.fish = static_cast<int>(v); });
  add("sea grass that sways", "1/m2", {0.5, 3, 15, 60}, kPictures,
      [](Scenario& s, double v) { s.terrain.swaying_density_per_m2 = v; });
  add("ground without texture", "1", {0.1, 0.05, 0.02, 0.005}, kPictures, [](Scenario& s, double v) {
    s.terrain.detail_contrast = v, s.terrain.roughness_m = 0.1 * v, s.terrain.ripples.height_m = 0.1 * v;
    s.terrain.rubble.density_per_m2 = s.terrain.boulders.density_per_m2 = s.terrain.corals.density_per_m2 = 0;
  });
  add("magnetic anomaly", "deg", {3, 10, 30, 90}, kFeatures, [](Scenario& s, double v) {
    s.sensors.compass.anomalies = {{0.5, 0.5, 2.5, degreesToRadians(v)}};
  });
  add("compass jumps", "deg", {3, 10, 30, 90}, kFeatures, [](Scenario& s, double v) {
    s.sensors.compass.jumps = {{80, degreesToRadians(v)}};
  });
  add("soft iron", "deg", {1, 3, 10, 30}, kFeatures,
      [](Scenario& s, double v) { s.sensors.compass.soft_iron = degreesToRadians(v); });
  add("compass lags", "s", {0.1, 0.3, 1, 5}, kFeatures,
      [](Scenario& s, double v) { s.sensors.compass.lag_s = v; });
  add("DVL silent", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.outages = {{70, 70 + v}};
  });
  add("DVL stuck", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.stuck = {{70, 70 + v}};
  });
  add("DVL on a false bottom", "s", {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v) {
    s.sensors.dvl.false_bottom = {{70, 70 + v}};
    s.sensors.dvl.current_east_mps = 0.2;
  });
  add("fish in the DVL's beams", "%", {1, 5, 20, 60}, kFeatures,
      [](Scenario& s, double v) { s.sensors.dvl.fish_probability = v / 100; });
  add("DVL noisier", "times", {3, 10, 30, 100}, kFeatures,
      [](Scenario& s, double v) { s.sensors.dvl.velocity_sigma_mps *= v; });
  add("USBL multipath", "m", {2, 8, 30, 200}, kFeatures, [](Scenario& s, double v) {
    s.sensors.usbl.multipath = {{80, kAllDive, v, -0.5 * v}};
  });
  add("ship's compass wanders", "deg", {1, 3, 10, 20}, kFeatures,
      [](Scenario& s, double v) { s.sensors.usbl.heading_wobble = degreesToRadians(v); });
  add("samples late and in batches", "s", {0.05, 0.2, 1, 3}, kFeatures, [](Scenario& s, double v) {
    s.sensors.arrival = {.jitter_s = 0.5 * v, .batch_s = v, .stamp_jitter_s = 0};
  });
  add("stamps jitter", "s", {0.005, 0.02, 0.1, 0.5}, kFeatures,
      [](Scenario& s, double v) { s.sensors.arrival.stamp_jitter_s = v; });
  add("something hits the hull", "m", {0.05, 0.2, 0.6, 2}, kFeatures, [](Scenario& s, double v) {
    s.vehicle.collisions = {{80, v, degreesToRadians(60 * v), 4}};
  });
  add("hovers", "s", {10, 30, 60, 120}, kFeatures, [](Scenario& s, double v) {
    s.vehicle.hovers = {{80, v}};
  });
  return all;
}

}  // namespace

std::span<const Perturbation> perturbations() {
  static const std::vector<Perturbation> kPerturbations = makePerturbations();
  return kPerturbations;
}

}  // namespace fathom::sim

#include "sim/campaign/perturbations.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

constexpr double kAllDive = 1e5;  // [s]

constexpr bool kPictures = true, kFeatures = false;  // of the dive

std::vector<Perturbation> makePerturbations() {
  std::vector<Perturbation> all;
  const auto add = [&](const char* name, const char* unit, double none, double usual,
                       std::array<double, Perturbation::kLevels> levels, bool pictures,
                       void (*disturb)(Scenario&, double, const Occasion&)) {
    all.push_back({name, unit, none, usual, levels, pictures, disturb});
  };
  add("cameras turned against each other", "deg", 0, 0.2, {0.1, 0.3, 1, 3}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.rig_angle = degreesToRadians(v); });
  add("focal lengths off", "%", 0, 0.3, {0.1, 0.5, 2, 5}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.focal = v / 100; });
  add("sensors' mounting off", "deg", 0, 0.5, {0.2, 1, 3, 10}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        s.calibration_errors.mounting_angle = degreesToRadians(v);
      });
  add("lever arms off", "m", 0, 0.02, {0.005, 0.02, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.lever_arm_m = v; });
  add("stamps off", "s", 0, 0.01, {0.005, 0.03, 0.1, 0.5}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.time_s = v; });
  add("right shutter late", "s", 0, 0.0005, {0.001, 0.004, 0.02, 0.05}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.cameras.right_delay_s = v; });
  add("marine snow", "1/m3", 0, 1000, {500, 3000, 10000, 50000}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.water.snow_per_m3 = v; });
  add("water more turbid", "times", 1, 3, {1.5, 3, 6, 12}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        for (double& b : s.optics.water.scattering_per_m) b *= v;
      });
  add("patches of sediment", "times", 0, 1, {0.5, 1.5, 4, 10}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.water.patches = v; });
  add("silt raised", "times", 1, 5, {2, 5, 15, 50}, kPictures, [](Scenario& s, double v, const Occasion& o) {
    s.optics.water.silt = {{o.at_s - 10, v, 20}};
  });
  add("forward scatter", "1/m", 0, 0.1, {0.05, 0.2, 0.6, 1.5}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.water.forward_per_m = v; });
  add("sun with caustics", "1", 0, 0.05, {0.02, 0.08, 0.3, 1}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        s.optics.daylight.irradiance = v, s.optics.daylight.caustics = 0.6;
      });
  add("strobes vary", "%", 0, 10, {5, 15, 40, 80}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.flash_sigma = v / 100; });
  add("a strobe misfires", "%", 0, 2, {1, 5, 20, 60}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.misfire_probability = v / 100; });
  add("pairs dark", "%", 0, 1, {1, 5, 20, 50}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.dark_probability = v / 100; });
  add("light too weak", "times", 1, 0.5, {0.5, 0.2, 0.05, 0.01}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.sensor.exposure *= v; });
  add("motion blur", "s", 0, 0.004, {0.002, 0.008, 0.03, 0.1}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.sensor.open_s = v; });
  add("out of focus (aperture)", "mm", 0, 4, {3, 10, 25, 50}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        s.optics.sensor.aperture_mm = v, s.optics.sensor.focus_m = 1;
      });
  add("fish", "1", 0, 5, {3, 15, 60, 300}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.terrain.fish = static_cast<int>(v); });
  add("sea grass that sways", "1/m2", 0, 1, {0.5, 3, 15, 60}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.terrain.swaying_density_per_m2 = v; });
  add("ground without texture", "1", 0.22, 0.1, {0.1, 0.05, 0.02, 0.005}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        TerrainConfig& t = s.terrain;
        const double share = v / t.detail_contrast;
        for (double* what : {&t.detail_contrast, &t.albedo_contrast, &t.roughness_m, &t.ripples.height_m,
                             &t.rubble.density_per_m2, &t.boulders.density_per_m2, &t.corals.density_per_m2})
          *what *= share;
      });
  add("principal points off", "% of width", 0, 0.1, {0.1, 0.3, 1, 3}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.centre = v / 100; });
  add("radial distortion off", "1", 0, 0.01, {0.005, 0.02, 0.05, 0.15}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.calibration_errors.radial = v; });
  add("baseline off", "%", 0, 0.5, {0.2, 0.7, 2, 5}, kPictures,
      [](Scenario& s, double v, const Occasion& o) { s.calibration_errors.baseline = o.sign * v / 100; });
  add("hull vibrates", "deg", 0, 0.005, {0.005, 0.02, 0.1, 0.3}, kPictures,
      [](Scenario& s, double v, const Occasion&) {
        s.optics.vibration_rad = degreesToRadians(v);
        s.optics.sensor.open_s = std::max(s.optics.sensor.open_s, 0.002);
      });
  add("glare of the strobes", "1", 0, 0.001, {0.001, 0.003, 0.01, 0.03}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.sensor.glare = v; });
  add("right camera darker", "times", 1, 0.8, {0.8, 0.5, 0.25, 0.1}, kPictures,
      [](Scenario& s, double v, const Occasion&) { s.optics.sensor.right_gain = v; });
  add("magnetic anomaly", "deg", 0, 10, {3, 10, 30, 90}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        constexpr double kBuried_m = 0.5;
        s.sensors.compass.anomalies = {
            {o.north_m, o.east_m, s.terrain.base_depth_m + kBuried_m, 2.5, o.sign * degreesToRadians(v)}};
      });
  add("compass jumps", "deg", 0, 10, {3, 10, 30, 90}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        s.sensors.compass.jumps = {{o.at_s + 10, o.sign * degreesToRadians(v)}};
      });
  add("soft iron", "deg", 0, 3, {1, 3, 10, 30}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.compass.soft_iron = degreesToRadians(v); });
  add("compass lags", "s", 0, 0.3, {0.1, 0.3, 1, 5}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.compass.lag_s = v; });
  add("DVL silent", "s", 0, 20, {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v, const Occasion& o) {
    s.sensors.dvl.outages = {{o.at_s, o.at_s + v}};
  });
  add("DVL stuck", "s", 0, 5, {5, 20, 60, 300}, kFeatures, [](Scenario& s, double v, const Occasion& o) {
    s.sensors.dvl.stuck = {{o.at_s, o.at_s + v}};
  });
  add("DVL on a false bottom", "s", 0, 5, {5, 20, 60, 300}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        s.sensors.dvl.false_bottom = {{o.at_s, o.at_s + v}};
        s.sensors.dvl.current_east_mps = 0.2 * o.sign;
      });
  add("fish in the DVL's beams", "%", 0, 5, {1, 5, 20, 60}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.dvl.fish_probability = v / 100; });
  add("DVL noisier", "times", 1, 3, {3, 10, 30, 100}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.dvl.velocity_sigma_mps *= v; });
  add("USBL multipath", "m", 0, 1, {2, 8, 30, 200}, kFeatures, [](Scenario& s, double v, const Occasion& o) {
    s.sensors.usbl.multipath = {UsblErrorBurst{{o.at_s + 10, kAllDive}, o.sign * v, -0.5 * o.sign * v}};
  });
  add("ship's compass wanders", "deg", 0, 1, {1, 3, 10, 20}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.usbl.heading_wobble = degreesToRadians(v); });
  add("samples late and in batches", "s", 0, 0.2, {0.05, 0.2, 1, 3}, kFeatures,
      [](Scenario& s, double v, const Occasion&) {
        s.sensors.arrival = {.jitter_s = 0.5 * v, .batch_s = v, .stamp_jitter_s = 0};
      });
  add("stamps jitter", "s", 0, 0.005, {0.005, 0.02, 0.1, 0.5}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.arrival.stamp_jitter_s = v; });
  add("something hits the hull", "m", 0, 0.2, {0.05, 0.2, 0.6, 2}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        s.vehicle.collisions = {{o.at_s + 10, v, o.sign * degreesToRadians(60 * v), 4}};
      });
  add("hovers", "s", 0, 10, {10, 30, 60, 120}, kFeatures, [](Scenario& s, double v, const Occasion& o) {
    s.vehicle.hovers = {{o.at_s + 10, v}};
  });
  add("tide that no model predicts", "m", 0, 1, {0.3, 1, 3, 8}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        s.sensors.tide = {.amplitude_m = v, .phase = o.sign * 1.0, .in_mission = 0};
      });
  add("swell", "m", 0, 1, {0.5, 1, 3, 8}, kFeatures, [](Scenario& s, double v, const Occasion& o) {
    s.sensors.waves.height_m = v, s.sensors.waves.towards = o.sign * degreesToRadians(70);
  });
  add("acceleration taken for gravity", "1", 0, 0.1, {0.05, 0.2, 0.5, 1}, kFeatures,
      [](Scenario& s, double v, const Occasion&) { s.sensors.compass.acceleration_share = v; });
  add("USBL transceiver turned", "deg", 0, 1, {0.5, 2, 5, 15}, kFeatures,
      [](Scenario& s, double v, const Occasion& o) {
        s.sensors.usbl.misalignment = o.sign * degreesToRadians(v);
      });
  return all;
}

}  // namespace

double Perturbation::levelOf(double dose) const {
  const double extreme = levels.back();
  const double level = none == 0 ? usual * dose : none * std::pow(usual / none, dose);
  return extreme > none ? std::min(level, extreme) : std::max(level, extreme);
}

std::span<const Perturbation> perturbations() {
  static const std::vector<Perturbation> kPerturbations = makePerturbations();
  return kPerturbations;
}

}  // namespace fathom::sim

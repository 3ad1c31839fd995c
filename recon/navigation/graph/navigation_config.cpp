#include "recon/navigation/graph/navigation_config.hpp"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::slam {
namespace {

void require(bool good, const char* name, double value, const char* range) {
  if (good) return;
  std::ostringstream text;
  text << "navigation graph: " << name << " = " << value << ", must be " << range;
  throw std::invalid_argument(text.str());
}

}  // namespace

void NavigationConfig::validate() const {
  noise.validate();
  require(max_keyframes > 1, "max_keyframes", max_keyframes, "above 1");
  require(max_links >= 0, "max_links", max_links, "0 or more");
  require(max_fixes >= 0, "max_fixes", max_fixes, "0 or more");
  require(reject_after > 0, "reject_after", reject_after, "above 0");
  require(reweighted >= 0, "reweighted", reweighted, "0 or more");
  require(known_scale >= 1, "known_scale", known_scale, "1 or more");
  const std::pair<const char*, double> positive[] = {
      {"reference_s", reference_s},     {"reference_turn", reference_turn},
      {"jump_heading", jump_heading},   {"gate", gate},
      {"turned_sigmas", turned_sigmas}, {"fix_gate", fix_gate},
      {"change_m", change_m},           {"change_rad", change_rad}};
  for (const auto& [name, value] : positive) require(value > 0, name, value, "above 0");
}

SensorNoise readSensorNoise(const ConfigTable& table, const SensorNoise& defaults) {
  SensorNoise n = defaults;
  const auto degrees = [&](const char* key, double fallback, double min, double max) {
    return kRadiansPerDegree * table.number(key, fallback / kRadiansPerDegree, min, max);
  };
  n.dvl_velocity = table.number("dvl_velocity_mps", n.dvl_velocity, 1e-4, 1);
  n.dvl_rate = table.number("dvl_rate_hz", n.dvl_rate, 0.1, 100);
  n.dvl_scale = table.number("dvl_scale", n.dvl_scale, 1e-5, 0.2);
  n.dvl_heading = degrees("dvl_heading_deg", n.dvl_heading, 0.001, 20);
  n.dvl_wander = table.number("dvl_wander", n.dvl_wander, 0, 0.5);
  n.dvl_wander_s = table.number("dvl_wander_s", n.dvl_wander_s, 0, 1000);
  n.dvl_place = table.number("dvl_place_m", n.dvl_place, 1e-4, 1);
  n.unknown_velocity = table.number("unknown_velocity_mps", n.unknown_velocity, 0.01, 5);
  n.heading = degrees("heading_deg", n.heading, 0.001, 20);
  n.heading_lag = table.number("heading_lag_s", n.heading_lag, 0, 10);
  n.tilt = degrees("tilt_deg", n.tilt, 0.001, 10);
  n.deviation = degrees("deviation_deg", n.deviation, 0.001, 45);
  n.deviation_drift = degrees("deviation_drift_deg", n.deviation_drift, 0, 5);
  n.deviation_turn = degrees("deviation_turn_deg", n.deviation_turn, 0, 45);
  n.tilt_bias = degrees("tilt_bias_deg", n.tilt_bias, 0.001, 10);
  n.tilt_turn = degrees("tilt_turn_deg", n.tilt_turn, 0, 10);
  n.unknown_turn = degrees("unknown_turn_degps", n.unknown_turn, 0.1, 90);
  n.gyro_walk = degrees("gyro_walk_deg", n.gyro_walk, 1e-5, 5);
  n.depth = table.number("depth_m", n.depth, 1e-4, 10);
  n.depth_offset = table.number("depth_offset_m", n.depth_offset, 0, 20);
  n.tide_rate = table.number("tide_rate_mps", n.tide_rate, 0, 0.01);
  n.depth_drift = table.number("depth_drift", n.depth_drift, 0, 1);
  n.usbl_shift = table.number("usbl_shift_m", n.usbl_shift, 0, 100);
  n.usbl_turn = degrees("usbl_turn_deg", n.usbl_turn, 0, 20);
  n.visual_scale = table.number("visual_scale", n.visual_scale, 0, 0.1);
  n.validate();
  return n;
}

SensorNoise withoutTideModel(SensorNoise noise) {
  constexpr double kSea = 0.5;  // [m]
  noise.depth_offset = std::hypot(noise.depth_offset, kSea);
  return noise;
}

SensorNoise withTideModel(SensorNoise noise) {
  constexpr double kLeft = 0.03;  // [1]: 9e-6 m/s, as 0.06 m twice a day
  noise.tide_rate *= kLeft;
  return noise;
}

}  // namespace fathom::slam

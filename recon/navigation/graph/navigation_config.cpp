#include "recon/navigation/graph/navigation_config.hpp"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "realtime/base/numbers/portable_math.hpp"

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

void visitSensorNoise(KeyVisitor& keys, SensorNoise& n) {
  keys.number("dvl_velocity_mps", n.dvl_velocity, "m/s", 1e-4, 1, "one ensemble");
  keys.number("dvl_rate_hz", n.dvl_rate, "Hz", 0.1, 100, "of the ensembles");
  keys.number("dvl_scale", n.dvl_scale, "1", 1e-5, 0.2, "scale, constant over a dive");
  keys.angle("dvl_heading_deg", n.dvl_heading, 0.001, 20, "mounting, constant over a dive");
  keys.number("dvl_wander", n.dvl_wander, "1", 0, 0.5, "the velocity's correlated error, as a share of it");
  keys.number("dvl_wander_s", n.dvl_wander_s, "s", 0, 1000, "its correlation time");
  keys.number("dvl_place_m", n.dvl_place, "m", 1e-4, 1, "its place against the camera, over turns");
  keys.number("unknown_velocity_mps", n.unknown_velocity, "m/s", 0.01, 5, "motion while the DVL is silent");
  keys.number("heading_lag_s", n.heading_lag, "s", 0, 10, "the compass behind a turn");
  keys.angle("heading_deg", n.heading, 0.001, 20, "one reading of the compass");
  keys.angle("tilt_deg", n.tilt, 0.001, 10, "one reading of roll and pitch");
  keys.angle("deviation_deg", n.deviation, 0.001, 45, "the compass's deviation at first");
  keys.angle("deviation_drift_deg", n.deviation_drift, "deg/s^(1/2)", 0, 5, "its change with time");
  keys.angle("deviation_turn_deg", n.deviation_turn, "deg/rad^(1/2)", 0, 45, "its change with heading");
  keys.angle("tilt_bias_deg", n.tilt_bias, 0.001, 10, "bias of roll and pitch against the camera at first");
  keys.angle("tilt_turn_deg", n.tilt_turn, "deg/rad^(1/2)", 0, 10,
             "its change with heading: half a turn reverses a bias that is the body's");
  keys.angle("unknown_turn_degps", n.unknown_turn, "deg/s", 0.1, 90, "turn while the compass is silent");
  keys.angle("gyro_walk_deg", n.gyro_walk, "deg/s^(1/2)", 1e-5, 5,
             "a gyro's turn, where there is one; its bias is estimated");
  keys.number("depth_m", n.depth, "m", 1e-4, 10,
              "one reading of depth in a calm sea; swell is added as measured");
  keys.number("depth_offset_m", n.depth_offset, "m", 0, 20,
              "the depth sensor's error or the sea's height at first; topside half a metre beside it where "
              "mission.toml has no tide model");
  keys.number(
      "tide_rate_mps", n.tide_rate, "m/s", 0, 0.01,
      "rate of the sea's height at first without a predicted tide (3 m of amplitude: 0.00042 at most); a "
      "thirtieth of it with one in mission.toml");
  keys.number("depth_drift", n.depth_drift, "m/s^(1/2)", 0, 1, "random walk of the rest");
  keys.number(
      "usbl_shift_m", n.usbl_shift, "m", 0, 100,
      "what all USBL positions share: the ship's place and the sound's path, by one position's standard "
      "deviation at least unless 0. A GPS of the ship with corrections and a calibrated mounting: 0.5");
  keys.angle("usbl_turn_deg", n.usbl_turn, 0, 20, "the transceiver's mounting; a calibrated one: 0.2");
  keys.number("usbl_wander_s", n.usbl_wander_s, "s", 0, 3600,
              "for how long its positions err alike; 0: each by itself");
  keys.number("visual_scale", n.visual_scale, "1", 0, 0.1,
              "common scale of paths and turns of all visual links, which does not average out");
  if (keys.reads()) n.validate();
}

SensorNoise withTide(SensorNoise noise, bool predicted) {
  constexpr double kSea = 0.5;    // [m]
  constexpr double kLeft = 0.03;  // [1]: 9e-6 m/s, as 0.06 m twice a day
  if (predicted)
    noise.tide_rate *= kLeft;
  else
    noise.depth_offset = hypotenuse(noise.depth_offset, kSea);
  return noise;
}

}  // namespace fathom::slam

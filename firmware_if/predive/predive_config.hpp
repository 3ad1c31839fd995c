#pragma once

#include "realtime/kernel/config_table.hpp"

namespace fathom::io {

// Table `[predive]` of onboard.toml: what counts as well before the launch.
struct PrediveConfig {
  // Least rates [Hz]; a device passes with 80 % of them.
  double dvl_hz = 2, compass_hz = 5, depth_hz = 1;
  double edge_px = 5;             // widest that the sharpest edges of an image may be (image_quality.hpp)
  double saturated_share = 0.05;  // most of an image's pixels that may be saturated
  double mean_min = 0.03, mean_max = 0.8;  // of an image, of full scale
  double pair_offset_s = 0.01;  // largest median and largest spread of the time between left and right
  double deck_depth_m = 5;      // the pressure sensor shows no more than this on deck
  double deck_tilt_deg = 45;    // nobody launches a vehicle that leans further
  double origin_km = 50;        // no fix is further from the mission's origin
  double least_charge = 0.2;    // of the battery, 0 to 1
  double vehicle_size_m = 5;    // no sensor is further from the body's origin
  bool system_clock = true;     // the system's clock must be synchronised; else it is noted only
  double clock_error_s = 0.1;   // largest error that the system states of its own clock
};
// Throws InputError for a value out of range.
[[nodiscard]] PrediveConfig readPrediveConfig(const ConfigTable& table, PrediveConfig defaults = {});

}  // namespace fathom::io

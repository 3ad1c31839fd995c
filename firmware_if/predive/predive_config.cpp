#include "firmware_if/predive/predive_config.hpp"

namespace fathom::io {

PrediveConfig readPrediveConfig(const ConfigTable& table, PrediveConfig defaults) {
  PrediveConfig config = defaults;
  config.dvl_hz = table.number("dvl_hz", defaults.dvl_hz, 0.01, 100);
  config.compass_hz = table.number("compass_hz", defaults.compass_hz, 0.01, 1000);
  config.depth_hz = table.number("depth_hz", defaults.depth_hz, 0.01, 1000);
  config.edge_px = table.number("edge_px", defaults.edge_px, 2, 100);
  config.saturated_share = table.number("saturated_share", defaults.saturated_share, 0, 1);
  config.mean_min = table.number("mean_min", defaults.mean_min, 0, 1);
  config.mean_max = table.number("mean_max", defaults.mean_max, 0, 1);
  config.pair_offset_s = table.number("pair_offset_s", defaults.pair_offset_s, 1e-6, 1);
  config.deck_depth_m = table.number("deck_depth_m", defaults.deck_depth_m, 0, 12000);
  config.deck_tilt_deg = table.number("deck_tilt_deg", defaults.deck_tilt_deg, 1, 90);
  config.origin_km = table.number("origin_km", defaults.origin_km, 0.1, 20'000);
  config.least_charge = table.number("least_charge", defaults.least_charge, 0, 1);
  config.vehicle_size_m = table.number("vehicle_size_m", defaults.vehicle_size_m, 0.1, 100);
  config.system_clock = table.boolean("system_clock", defaults.system_clock);
  config.clock_error_s = table.number("clock_error_s", defaults.clock_error_s, 1e-6, 1000);
  return config;
}

}  // namespace fathom::io

#include "recon/stereo/stereo_config.hpp"

#include "recon/stereo/patch_tracker.hpp"

namespace fathom::stereo {

SparseStereoConfig readSparseStereoConfig(const ConfigTable& table, const SparseStereoConfig& defaults) {
  SparseStereoConfig c = defaults;
  const auto whole = [&](const char* key, int fallback, int min, int max) {
    return static_cast<int>(table.integer(key, fallback, min, max));
  };
  c.max_features = whole("max_features", c.max_features, 20, 5000);
  c.window = whole("window_px", c.window, PatchTracker::kMinWindow, PatchTracker::kMaxWindow);
  if (c.window % 2 == 0) table.fail("window_px", "must be odd");
  c.max_epipolar_distance = table.number("max_epipolar_px", c.max_epipolar_distance, 0.1, 10);
  c.max_left_right_distance = table.number("max_left_right_px", c.max_left_right_distance, 0.05, 10);
  c.max_core_distance = table.number("max_core_px", c.max_core_distance, 0.05, 10);
  c.min_correlation = table.number("min_correlation", c.min_correlation, 0, 0.99);
  c.sigma_scale = table.number("sigma_scale", c.sigma_scale, 0.1, 10);
  c.search_radius = table.number("search_radius_px", c.search_radius, 1, 256);
  c.min_range = table.number("min_range_m", c.min_range, 0.05, 50);
  c.max_range = table.number("max_range_m", c.max_range, 0.1, 100);
  if (c.max_range <= c.min_range) table.fail("max_range_m", "must be greater than min_range_m");
  c.max_edge = table.number("max_edge_m", c.max_edge, 0.01, 10);
  c.min_patch_points = whole("min_patch_points", c.min_patch_points, 1, 1000);
  c.max_fish_length = table.number("max_fish_length_m", c.max_fish_length, 0, 10);
  return c;
}

}  // namespace fathom::stereo

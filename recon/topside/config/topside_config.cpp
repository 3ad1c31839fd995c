#include "recon/topside/config/topside_config.hpp"

#include "realtime/base/config_table.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {
namespace {

// Noise of sparse stereo from 2 m is about a voxel of the default grid: the band holds three, the blend five.
constexpr double kBandVoxels = 3.0, kBorderVoxels = 5.0;

void readLighting(const ConfigTable& table, TopsideConfig& config) {
  config.lighting_images = static_cast<int>(table.integer("images", config.lighting_images, 1, 100000));
  config.lighting = lighting::readLightingConfig(table, config.lighting);
}

void readStereo(const ConfigTable& table, TopsideConfig& config) {
  config.stereo = stereo::readSparseStereoConfig(table, config.stereo);
  config.dense_stereo =
      table.choice("method", config.dense_stereo ? "dense" : "sparse", {"sparse", "dense"}) == "dense";
  config.dense.scale = table.number("dense_scale", config.dense.scale, 0.1, 1);
  config.dense.block = static_cast<int>(table.integer("dense_block_px", config.dense.block, 1, 21));
  if (config.dense.block % 2 == 0) table.fail("dense_block_px", "must be odd");
  config.mend_rig = table.boolean("mend_rig", config.mend_rig);
  config.min_points = static_cast<int>(table.integer("min_points", config.min_points, 3, 5000));
}

void readFusion(const ConfigTable& table, TopsideConfig& config) {
  setVoxel(config, table.number("voxel_m", config.fusion.voxel, 0.002, 2));
  fusion::VolumetricConfig& f = config.fusion;
  f.truncation = table.number("truncation_m", f.truncation, f.voxel, 32 * f.voxel);
  f.border = table.number("border_m", f.border, 0.001, 10);
  f.min_observations = static_cast<int>(table.integer("min_observations", f.min_observations, 1, 1000));
  f.carve = table.boolean("carve", f.carve);
  config.min_component = table.number("min_component_m2", config.min_component, 0, 1000);
}

}  // namespace

void setVoxel(TopsideConfig& config, double voxel) {
  config.fusion.voxel = voxel;
  config.fusion.truncation = kBandVoxels * voxel;
  config.fusion.border = kBorderVoxels * voxel;
}

TopsideConfig readTopsideConfig(const std::filesystem::path& path) {
  TopsideConfig config;
  const ConfigTable root = ConfigTable::load(path);
  readLighting(root.table("lighting"), config);
  readStereo(root.table("stereo"), config);
  readFusion(root.table("fusion"), config);
  const ConfigTable navigation = root.table("navigation");
  config.max_dvl_gap = navigation.number("max_dvl_gap_s", config.max_dvl_gap, 0.1, 60);
  config.max_speed = navigation.number("max_speed_mps", config.max_speed, 0.1, 20);
  config.default_altitude = navigation.number("default_altitude_m", config.default_altitude, 0.5, 20);
  const ConfigTable slam = root.table("slam");
  config.slam = slam.boolean("enabled", config.slam);
  config.slam_features = static_cast<int>(slam.integer("features", config.slam_features, 50, 5000));
  config.bundle = slam.boolean("bundle", config.bundle);
  config.slam_candidates =
      static_cast<int>(slam.integer("candidates_per_pair", config.slam_candidates, 1, 100));
  config.navigation.turned_sigmas = slam.number("turned_sigmas", config.navigation.turned_sigmas, 1, 100);
  config.navigation.noise = slam::readSensorNoise(root.table("sensors"), config.navigation.noise);
  const ConfigTable run = root.table("run");
  config.pairing_tolerance = run.number("pairing_tolerance_s", config.pairing_tolerance, 0.001, 1);
  config.threads = static_cast<int>(run.integer("threads", config.threads, 0, 256));
  root.finish();
  return config;
}

void addNavigationSettings(Hasher& hasher, const TopsideConfig& config) {
  hasher.add(config.max_dvl_gap, config.max_speed, config.default_altitude, config.pairing_tolerance,
             config.navigation.noise.unknown_velocity, config.navigation.noise.usbl_shift);
}

void addStereoSettings(Hasher& hasher, const TopsideConfig& config) {
  const stereo::SparseStereoConfig& c = config.stereo;
  static_assert(sizeof c == 104);
  hasher.add(c.max_features, c.window, c.max_epipolar_distance, c.max_left_right_distance,
             c.max_core_distance, c.sigma_scale, c.max_edge, c.min_range, c.max_range, c.search_radius,
             c.min_correlation, c.max_slope, c.min_patch_points, c.max_fish_length);
  hasher.add(config.dense_stereo, config.dense.scale, config.dense.block, config.mend_rig, config.min_points);
}

void addModelSettings(Hasher& hasher, const TopsideConfig& config) {
  const ModelSettings& m = config.model;
  hasher.add(m.texture, m.max_atlas, m.gpu_texture, m.picture.format, m.picture.quality,
             m.picture.half_chroma, m.picture.webp_effort);
  const surface::BlendConfig& b = m.blend;
  hasher.add(b.mode, b.sharpness[0], b.sharpness[1], b.sharpness[2], b.bands.fine, b.bands.coarse,
             b.bands.reduction, b.vote, b.tolerance, b.views_of_a_place);
}

}  // namespace fathom::topside

#include "recon/topside/config/topside_config.hpp"

#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {
namespace {

// Noise of sparse stereo from 2 m is about a voxel of the default grid: the band holds three, the blend five.
constexpr double kBandVoxels = 3.0, kBorderVoxels = 5.0;

void visitStereo(KeyVisitor& keys, TopsideConfig& c) {
  constexpr const char* kMethods[] = {"sparse", "dense"};
  stereo::visitSparseStereo(keys, c.stereo);
  keys.choiceOf("method", c.dense_stereo, kMethods, "corners, or semi-global matching (--dense)");
  keys.number("dense_scale", c.dense.scale, "of the image's side", 0.1, 1, "that is matched");
  keys.integer("dense_block_px", c.dense.block, "px", 1, 21,
               "edge of the matched window, of the scaled image, odd");
  keys.require(c.dense.block % 2 == 1, "dense_block_px", "must be odd");
  keys.boolean("mend_rig", c.mend_rig,
               "the rig is taken as matches and paths of the dive show it; false: as calibrated");
  keys.integer("min_points", c.min_points, "points", 3, 5000, "a pair with fewer is left out");
}

void visitFusion(KeyVisitor& keys, TopsideConfig& config) {
  fusion::VolumetricConfig& f = config.fusion;
  double voxel = f.voxel;
  keys.number("voxel_m", voxel, "m", 0.002, 2, "edge of a voxel");
  if (keys.reads()) setVoxel(config, voxel);
  keys.number("truncation_m", f.truncation, "m", f.voxel, 32 * f.voxel,
              "band on either side of the surface, 1 to 32 voxels; by default 3 voxels");
  keys.number("border_m", f.border, "m", 0.001, 10,
              "over which weights fall to a mesh's border; by default 5 voxels");
  keys.integer("min_observations", f.min_observations, "meshes", 1, 1000, "that must have seen a voxel");
  keys.boolean("carve", f.carve, "what was seen through is empty");
  keys.number("min_component_m2", config.min_component, "m2", 0, 1000, "smaller loose pieces are dropped");
}

void visitModel(KeyVisitor& keys, ModelSettings& m) {
  constexpr double kFinestTexel = 0.0001;  // [m]
  constexpr const char* kModes[] = {"bands", "average", "unblended"};
  constexpr const char* kPictures[] = {"jpeg", "webp"};
  constexpr const char* kGpuTextures[] = {"none", "ktx2", "dds"};
  keys.boolean("texture", m.texture, "false (--no-texture): colours by vertex alone");
  keys.number("texel_m", m.texel, "m", 0, 1, "finest texel (--texel); 0: a pixel's size on the ground");
  keys.require(m.texel == 0 || m.texel >= kFinestTexel, "texel_m", "must be 0, or 0.0001 to 1");
  keys.choiceOf("blend", m.blend.mode, kModes, "how images are blended (--mode)");
  bool webp = m.picture.format == PictureFormat::kWebp;
  keys.choiceOf("pictures", webp, kPictures, "textures in the tiles (--textures)");
  m.picture.format = webp ? PictureFormat::kWebp : PictureFormat::kJpeg;
  keys.integer("picture_quality", m.picture.quality, 1, 100, "on the format's own scale");
  keys.choiceOf("gpu_texture", m.gpu_texture, kGpuTextures, "BC1 for GPUs beside the tiles (--textures)");
  keys.number("overlap_m", m.division.overlap, "m", 0.5, 10,
              "around a piece, from which it takes meshes too");
}

}  // namespace

void setVoxel(TopsideConfig& config, double voxel) {
  config.fusion.voxel = voxel;
  config.fusion.truncation = kBandVoxels * voxel;
  config.fusion.border = kBorderVoxels * voxel;
}

void visitTopside(KeyVisitor& keys, TopsideConfig& c) {
  keys.table("lighting", "", [&] {
    keys.integer("images", c.lighting_images, "pairs", 1, 100000,
                 "that the model learns from, spread over the mission");
    lighting::visitLighting(keys, c.lighting);
  });
  keys.table("stereo", "", [&] { visitStereo(keys, c); });
  keys.table("fusion", "", [&] { visitFusion(keys, c); });
  keys.table("model", "", [&] { visitModel(keys, c.model); });
  keys.table("navigation", "dead reckoning", [&] {
    keys.number("max_dvl_gap_s", c.max_dvl_gap, "s", 0.1, 60,
                "without bottom track before the velocity decays");
    keys.number("max_speed_mps", c.max_speed, "m/s", 0.1, 20, "faster bottom track is rejected");
    keys.number("default_altitude_m", c.default_altitude, "m", 0.5, 20, "seeds stereo until the DVL knows");
  });
  keys.table("slam", "odometry, closures and bundle adjustment", [&] {
    keys.boolean("enabled", c.slam, "false (--no-slam): dead reckoning");
    keys.integer("features", c.slam_features, 50, 5000, "of a pair, for odometry and closures");
    keys.boolean("bundle", c.bundle, "false (--no-bundle): poses by the links alone");
    keys.integer("candidates_per_pair", c.slam_candidates, 1, 100,
                 "closures tried, at most: at the mean, and of a pair in a round");
    keys.number("turned_sigmas", c.navigation.turned_sigmas, "standard deviations", 1, 100,
                "between compass and visual turn in a step that is counted as contradicted");
  });
  keys.table("sensors", "standard deviations of the navigation sensors, the same on board",
             [&] { slam::visitSensorNoise(keys, c.navigation.noise); });
  keys.table("run", "", [&] {
    keys.number("pairing_tolerance_s", c.pairing_tolerance, "s", 0.001, 1,
                "between left and right of a pair");
    keys.integer("threads", c.threads, 0, 256, "0: all cores (--jobs)");
  });
}

TopsideConfig readTopsideConfig(const std::filesystem::path& path) {
  TopsideConfig config;
  ConfigReader keys(ConfigTable::load(path));
  visitTopside(keys, config);
  keys.finish();
  return config;
}

std::string topsideToml(const TopsideConfig& config) {
  return configToml(config, TopsideConfig(), visitTopside);
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

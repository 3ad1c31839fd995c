#include "recon/topside/work/stage_keys.hpp"

namespace fathom::topside {

void addNavigationSettings(Hasher& hasher, const TopsideConfig& config) {
  hasher.add(config.max_dvl_gap, config.max_speed, config.default_altitude, config.pairing_tolerance,
             config.navigation.noise.unknown_velocity);
}

void addLightingSettings(Hasher& hasher, const TopsideConfig& config) {
  const lighting::LightingConfig& c = config.lighting;
  static_assert(sizeof c == 48);
  hasher.add(config.lighting_images, c.target_mean, c.target_sigma, c.min_images, c.grid, c.saturated,
             c.outlier, c.choice);
}

void addStereoSettings(Hasher& hasher, const TopsideConfig& config) {
  const stereo::SparseStereoConfig& c = config.stereo;
  static_assert(sizeof c == 104);
  hasher.add(c.max_features, c.window, c.max_epipolar_distance, c.max_left_right_distance,
             c.max_core_distance, c.sigma_scale, c.max_edge, c.min_range, c.max_range, c.search_radius,
             c.min_correlation, c.max_slope, c.min_patch_points, c.max_fish_length);
  hasher.add(config.dense_stereo, config.dense.scale, config.dense.block, config.min_points);
}

void addSlamSettings(Hasher& hasher, const TopsideConfig& config) {
  const slam::SensorNoise& n = config.navigation.noise;
  static_assert(sizeof n == 160);
  hasher.add(config.slam, config.slam_features, config.slam_candidates, n.dvl_velocity, n.dvl_rate,
             n.dvl_scale, n.dvl_heading, n.unknown_velocity, n.heading, n.tilt, n.deviation,
             n.deviation_drift, n.deviation_turn, n.tilt_bias, n.tilt_turn, n.unknown_turn, n.gyro_walk,
             n.depth, n.depth_offset, n.depth_drift, n.usbl_shift, n.usbl_turn, n.visual_scale);
}

void addFusionSettings(Hasher& hasher, const TopsideConfig& config) {
  const fusion::VolumetricConfig& c = config.fusion;
  hasher.add(c.voxel, c.truncation, c.min_observations, c.border, c.carve, config.min_component);
}

void addModelSettings(Hasher& hasher, const TopsideConfig& config) {
  const ModelSettings& m = config.model;
  hasher.add(m.texture, m.max_atlas, m.gpu_texture, m.picture.format, m.picture.quality,
             m.picture.half_chroma, m.picture.webp_effort);
  const surface::BlendConfig& b = m.blend;
  hasher.add(b.mode, b.sharpness[0], b.sharpness[1], b.sharpness[2], b.bands.fine, b.bands.coarse,
             b.bands.reduction, b.vote, b.tolerance, b.views_of_a_place);
}

void addPose(Hasher& hasher, const SE3& pose) {
  const Eigen::Vector4d& q = pose.rotation().coeffs();
  const Eigen::Vector3d& t = pose.translation();
  hasher.add(q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z());
}

void addRig(Hasher& hasher, const MissionInput& input) {
  for (const Camera* c : {&input.rig.left, &input.rig.right})
    hasher.add(c->width, c->height, c->fx, c->fy, c->cx, c->cy, c->k1, c->k2, c->p1, c->p2, c->k3);
  addPose(hasher, input.rig.T_right_left);
  const io::MissionConfig& m = input.mission;
  addPose(hasher, m.T_body_cam);
  addPose(hasher, m.T_body_dvl);
  hasher.add(m.cameras.left_format, m.cameras.right_format, m.cameras.bits, input.features_only);
}

}  // namespace fathom::topside

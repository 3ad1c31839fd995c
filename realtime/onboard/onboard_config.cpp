#include "realtime/onboard/onboard_config.hpp"

#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::onboard {
namespace {

int whole(const ConfigTable& t, const char* key, int fallback, int min, int max) {
  return static_cast<int>(t.integer(key, fallback, min, max));
}

void read(const ConfigTable& t, fusion::QuadtreeConfig& c) {
  c.root_size = t.number("root_size_m", c.root_size, 1, 1024);
  if (std::exp2(std::round(std::log2(c.root_size))) != c.root_size)
    t.fail("root_size_m", "must be a power of two: 1, 2, 4, ... 1024");
  c.max_level = whole(t, "max_level", c.max_level, 0, 12);
  c.max_tiles = whole(t, "max_tiles", c.max_tiles, 16, 1 << 20);
  c.layers_per_tile = whole(t, "layers_per_tile", c.layers_per_tile, 1, 4096);
  c.min_sigma = t.number("min_sigma_m", c.min_sigma, 1e-4, 1);
}

void read(const ConfigTable& t, LinkCoreConfig& c) {
  telemetry::LinkSchedulerConfig& s = c.scheduler;
  s.rate_bps = t.number("rate_bps", s.rate_bps, 80, 5400);
  s.frame_bytes = whole(t, "frame_bytes", s.frame_bytes, 32, 256);
  s.modem_bytes = whole(t, "modem_bytes", s.modem_bytes, 0, 2048);
  s.padded = t.boolean("padded", s.padded);
  s.preamble_s = t.number("preamble_s", s.preamble_s, 0, 5);
  s.loss_rate = t.number("loss_rate", s.loss_rate, 0, 0.9);
  s.duty = t.number("duty", s.duty, 0.05, 1);
  s.mean_burst = t.number("mean_burst", s.mean_burst, 0, 100);
  s.repair = t.boolean("repair", s.repair);
  s.half_duplex = t.boolean("half_duplex", s.half_duplex);
  s.listen_every_s = t.number("listen_every_s", s.listen_every_s, 0, 3600);
  s.listen_every_frames = whole(t, "listen_every_frames", s.listen_every_frames, 0, 256);
  s.listen_s = t.number("listen_s", s.listen_s, 0, 60);
  s.max_delay_s = t.number("max_delay_s", s.max_delay_s, 0, 30);
  s.colour_bits = whole(t, "colour_bits", s.colour_bits, 0, 6);
  telemetry::HousekeepingConfig& h = s.housekeeping;
  h.share = t.number("housekeeping_share", h.share, 0.01, 1);
  h.status_period_s = t.number("status_period_s", h.status_period_s, 1, 3600);
  h.mission_info_period_s = t.number("mission_info_period_s", h.mission_info_period_s, 10, 3600);
  h.track_interval_s = t.number("track_interval_s", h.track_interval_s, 0.5, 600);
  telemetry::BlockQueueConfig& b = s.blocks;
  b.spacing = t.number("spacing_m", b.spacing, 1.0 / 64, 16);
  b.coarse_spacing = t.number("coarse_spacing_m", b.coarse_spacing, b.spacing, 64);
  b.max_error = t.number("max_error_m", b.max_error, 0.005, 1);
  b.update_error = t.number("update_error_m", 1.5 * b.max_error, b.max_error, 10);
  b.deadline_s = t.number("deadline_s", b.deadline_s, 0, 3600);
  b.coarse_after_s = t.number("coarse_after_s", b.coarse_after_s, 0, 3600);
  b.settle_s = t.number("settle_s", b.settle_s, 0, 600);
  b.max_wait_s = t.number("max_wait_s", std::max(b.max_wait_s, b.settle_s), b.settle_s, 3600);
  b.max_squares = whole(t, "max_squares", b.max_squares, 16, 65536);
}

void read(const ConfigTable& t, OnboardConfig& config) {
  LocalisationConfig& c = config.localisation;
  c.enabled = t.boolean("enabled", c.enabled);
  c.max_keyframes = whole(t, "max_keyframes", c.max_keyframes, 2, 100000);
  c.keyframe_overlap = t.number("keyframe_overlap", c.keyframe_overlap, 0.05, 0.99);
  c.keyframe_turn = t.number("keyframe_turn_rad", c.keyframe_turn, 0.01, 3.2);
  c.keyframe_s = t.number("keyframe_s", c.keyframe_s, 0.1, 3600);
  c.features = whole(t, "features", c.features, 50, 5000);
  c.closures_per_keyframe = whole(t, "closures_per_keyframe", c.closures_per_keyframe, 0, 1000);
  c.place_tries = whole(t, "place_tries", c.place_tries, 0, 100);
  c.predictions_per_keyframe = whole(t, "predictions_per_keyframe", c.predictions_per_keyframe, 1, 10000);
  c.closures_waiting = static_cast<std::size_t>(
      t.integer("closures_waiting", static_cast<std::int64_t>(c.closures_waiting), 1, 100000));
  c.graph.max_links = whole(t, "max_links", c.graph.max_links, 1, 200000);
  c.graph.max_fixes = whole(t, "max_fixes", c.graph.max_fixes, 0, 100000);
  c.graph.known_scale = t.number("known_scale", c.graph.known_scale, 1, 100);
  c.graph.turned_sigmas = t.number("turned_sigmas", c.graph.turned_sigmas, 1, 100);
  config.max_pairs = whole(t, "max_pairs", config.max_pairs, 1, 1000000);
  config.rebuild_meshes = whole(t, "rebuild_meshes", config.rebuild_meshes, 1, 10000);
  config.slot_folder = t.text("slot_folder", config.slot_folder.string());
}

}  // namespace

OnboardConfig readOnboardConfig(const std::optional<std::filesystem::path>& path,
                                const io::MissionConfig& mission) {
  OnboardConfig config;
  config.map.max_level = 6;  // cells down to 3.1 cm where points are dense enough
  config.map.max_tiles = 8192;
  if (!path) return config;

  const ConfigTable root = ConfigTable::load(*path);
  config.stereo = stereo::readSparseStereoConfig(root.table("stereo"), config.stereo);
  config.lighting = lighting::readLightingConfig(root.table("lighting"), config.lighting);
  read(root.table("map"), config.map);
  const ConfigTable link = root.table("link");
  read(link, config.link);
  // Beside the configuration, unless it says where.
  const std::filesystem::path key_file = link.text("key_file", "");
  if (!key_file.empty())
    config.link_key = telemetry::readLinkKey(path->parent_path() / key_file, config.warning);
  config.link.root_size = config.map.root_size;
  config.link.max_level = config.map.max_level;
  read(root.table("slam"), config);
  slam::SensorNoise& noise = config.localisation.graph.noise;
  noise = slam::readSensorNoise(root.table("sensors"), noise);
  const ConfigTable nav = root.table("nav");
  config.drift_share = nav.number("drift_share", config.drift_share, 0, 1);
  config.max_pair_skew = nav.number("max_pair_skew_s", config.max_pair_skew, 1e-4, 0.5);
  auto& reckoning = config.reckoning;
  reckoning.max_dvl_gap = nav.number("max_dvl_gap_s", reckoning.max_dvl_gap, 0.1, 60);
  reckoning.max_speed = nav.number("max_speed_mps", reckoning.max_speed, 0.1, 20);
  reckoning.max_turn_rate = nav.number("max_turn_rate_radps", reckoning.max_turn_rate, 0.1, 10);
  const ConfigTable output = root.table("output");
  config.odometry_interval = output.number("odometry_interval_s", config.odometry_interval, 0.01, 60);
  config.health_interval = output.number("health_interval_s", config.health_interval, 0.1, 60);
  config.live = readLiveConfig(root, mission);
  root.finish();
  try {
    config.link.validate();
  } catch (const std::invalid_argument& e) {
    throw InputError(path->string(), "[link]", e.what());
  }
  std::ifstream in(*path);
  config.text.assign(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  return config;
}

NavCoreConfig navCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission) {
  NavCoreConfig nav;
  nav.odometry = config.reckoning;
  nav.odometry.T_body_dvl = mission.T_body_dvl;
  nav.odometry.T_body_depth = mission.T_body_depth;
  nav.odometry.T_body_compass = mission.T_body_compass;
  nav.odometry.magnetic_declination = mission.magnetic_declination;
  nav.odometry.origin_latitude = mission.origin.latitude;
  nav.odometry.sound_speed = mission.water.sound_speed;
  nav.odometry.phased_array = mission.dvl.phased_array;
  nav.start_utc_ns = mission.start_utc_ns;
  nav.odometry.tide = readTide(mission.tide_model, mission.start_utc_ns);
  nav.pairing_tolerance = config.max_pair_skew;
  const io::MissionConfig::TimeOffsets& t = mission.time_offsets;
  nav.time_offsets = {t.left_camera, t.right_camera, t.dvl, t.compass, t.depth};
  return nav;
}

MapCoreConfig mapCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission,
                            const StereoRig& rig) {
  MapCoreConfig map{rig,
                    mission.T_body_cam,
                    mission.T_body_dvl,
                    mission.cameras.left_format,
                    mission.cameras.right_format,
                    mission.cameras.bits,
                    config.stereo,
                    config.lighting,
                    config.map,
                    config.rebuild_meshes,
                    config.localisation,
                    config.colours};
  map.localisation.graph.dvl_in_camera = mission.T_body_cam.inverse() * mission.T_body_dvl.translation();
  slam::SensorNoise& noise = map.localisation.graph.noise;
  if (readTide(mission.tide_model, mission.start_utc_ns)) noise = slam::withTideModel(noise);
  slam::RigPrior& prior = map.localisation.graph.rig;
  prior.baseline = rig.baseline();
  // Epipolar lines have not been looked at when the dive begins.
  constexpr double kUnmeasuredTurn = 0.009;  // half a degree: a rig is knocked by as much [rad]
  prior.turn = kUnmeasuredTurn;
  map.localisation.graph.forward_in_camera =
      mission.T_body_cam.rotation().conjugate() * Eigen::Vector3d::UnitX();
  return map;
}

LinkCoreConfig linkCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission) {
  LinkCoreConfig link = config.link;
  link.root_size = config.map.root_size;
  link.max_level = config.map.max_level;
  link.scheduler.identity = {mission.vehicle_id, mission.dive_id};
  link.scheduler.tag = telemetry::FrameTag(config.link_key);
  link.scheduler.first = telemetry::firstVersion(mission.start_utc_ns);
  return link;
}

}  // namespace fathom::onboard

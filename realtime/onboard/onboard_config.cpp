#include "realtime/onboard/onboard_config.hpp"

#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "realtime/base/input_error.hpp"
#include "recon/navigation/graph/navigation_config.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::onboard {
namespace {

void visitMap(KeyVisitor& keys, fusion::QuadtreeConfig& c) {
  keys.number("root_size_m", c.root_size, "m", 1, 1024, "edge of a root square, a power of two");
  keys.require(std::exp2(std::round(std::log2(c.root_size))) == c.root_size, "root_size_m",
               "must be a power of two: 1, 2, 4, ... 1024");
  keys.integer(
      "max_level", c.max_level, 0, 12,
      "finest tiles: root size / 2^level, 16 cells a side; 6: cells of 3.1 cm where points are dense");
  keys.integer("max_tiles", c.max_tiles, 16, 1 << 20, "pool of tiles, 1.4 kB each");
  keys.integer("layers_per_tile", c.layers_per_tile, 1, 4096, "pool of layers, for each tile, 48 B each");
  keys.number("min_sigma_m", c.min_sigma, "m", 1e-4, 1, "no observation counts as better");
}

void visitLink(KeyVisitor& keys, LinkCoreConfig& c) {
  telemetry::LinkSchedulerConfig& s = c.scheduler;
  keys.number("rate_bps", s.rate_bps, "bit/s", 80, 5400, "of the acoustic link");
  keys.integer("frame_bytes", s.frame_bytes, "B", 32, 256, "largest frame");
  keys.integer(
      "modem_bytes", s.modem_bytes, "B", 0, 2048,
      "what the modem takes at once, 64 and frame_bytes + 2 at least: so many bytes of link frames go as a "
      "bundle; 0: each link frame by itself");
  keys.boolean("padded", s.padded, "bundles are filled with zeros, for a modem whose frames are of one size");
  keys.number("preamble_s", s.preamble_s, "s", 0, 5, "that the modem needs for each frame beside its bits");
  keys.number("loss_rate", s.loss_rate, "of the frames", 0, 0.9, "lost, expected until it is measured");
  keys.number("duty", s.duty, "of the time", 0.05, 1, "that the modem may send");
  keys.number("mean_burst", s.mean_burst, "frames", 0, 100,
              "lost in a row, expected until it is measured; 0: each frame by itself");
  keys.boolean("repair", s.repair, "Reed-Solomon frames while nobody acknowledges");
  keys.boolean("half_duplex", s.half_duplex, "takes turns with the ship; false: never listens");
  keys.number("listen_every_s", s.listen_every_s, "s", 0, 3600, "0: by rule from rate, frame and delay");
  keys.integer("listen_every_frames", s.listen_every_frames, "frames", 0, 256, "0: by rule");
  keys.number("listen_s", s.listen_s, "s", 0, 60, "0: by rule");
  keys.number("max_delay_s", s.max_delay_s, "s", 0, 30, "of sound and modems in one direction");
  keys.integer("colour_bits", s.colour_bits, "bit", 0, 6, "of brightness; 0 sends no colour");
  telemetry::HousekeepingConfig& h = s.housekeeping;
  keys.number("housekeeping_share", h.share, "of the rate", 0.01, 1,
              "for status, track and mission information; more only while nothing else is to be sent");
  keys.number("status_period_s", h.status_period_s, "s", 1, 3600, "stretched to keep the share");
  keys.number("mission_info_period_s", h.mission_info_period_s, "s", 10, 3600, "the same");
  keys.number("track_interval_s", h.track_interval_s, "s", 0.5, 600, "the same, between points of the track");
  telemetry::BlockQueueConfig& b = s.blocks;
  keys.number("spacing_m", b.spacing, "m", 1.0 / 64, 16, "of nodes; root size / 16 over a power of two");
  keys.number("coarse_spacing_m", b.coarse_spacing, "m", b.spacing, 64, "of the coarse nodes");
  const double max_error = b.max_error;
  keys.number("max_error_m", b.max_error, "m", 0.005, 1, "of a node as received");
  if (b.max_error != max_error) b.update_error = 1.5 * b.max_error;
  keys.number("update_error_m", b.update_error, "m", b.max_error, 10,
              "what makes a block worth sending again; by default 1.5 times max_error_m");
  keys.number("deadline_s", b.deadline_s, "s", 0, 3600, "lost blocks go first until then");
  keys.number("coarse_after_s", b.coarse_after_s, "s", 0, 3600, "areas that waited so long go coarse first");
  keys.number("settle_s", b.settle_s, "s", 0, 600,
              "a block still growing waits so long after its last change");
  b.max_wait_s = std::max(b.max_wait_s, b.settle_s);
  keys.number("max_wait_s", b.max_wait_s, "s", b.settle_s, 3600, "and so long in all");
  keys.integer("max_squares", b.max_squares, 16, 65536, "squares of 16 x 16 nodes held, 4 kB each");
}

void visitSlam(KeyVisitor& keys, OnboardConfig& config) {
  LocalisationConfig& c = config.localisation;
  keys.boolean("enabled", c.enabled, "false, or --no-slam: dead reckoning and a fixed T_nav_odom");
  keys.integer(
      "max_keyframes", c.max_keyframes, 2, 100000,
      "held at once, a pool and a slot file: for another one the least needed retires; a replay takes no "
      "more than its mission has");
  keys.number("keyframe_overlap", c.keyframe_overlap, "1", 0.05, 0.99,
              "a new keyframe where the footprint shares less with the last one's");
  keys.number("keyframe_turn_rad", c.keyframe_turn, "rad", 0.01, 3.2, "or after so much turning");
  keys.number("keyframe_s", c.keyframe_s, "s", 0.1, 3600, "or after so long");
  keys.integer("features", c.features, 50, 5000, "of a keyframe; 600 are 110,408 B a slot");
  keys.integer("closures_per_keyframe", c.closures_per_keyframe, 0, 1000, "registrations tried");
  keys.integer("place_tries", c.place_tries, 0, 100,
               "registrations of the newest keyframe without prior, where nothing was closed for a while");
  keys.integer("predictions_per_keyframe", c.predictions_per_keyframe, 1, 10000,
               "relative covariances asked of the graph");
  keys.integer("closures_waiting", c.closures_waiting, 1, 100000,
               "candidates in the queue; when full the least valuable goes");
  keys.integer("max_links", c.graph.max_links, 1, 200000, "of the keyframes held; full, a keyframe retires");
  keys.integer("max_fixes", c.graph.max_fixes, 0, 100000, "the same");
  keys.number(
      "known_scale", c.graph.known_scale, "1", 1, 100,
      "of the graph's covariance where it judges a closure or a recognised place: larger lets more in, "
      "larger errors too");
  keys.number("turned_sigmas", c.graph.turned_sigmas, "standard deviations", 1, 100,
              "between compass and visual turn in a step that is counted as contradicted");
  keys.integer(
      "max_pairs", config.max_pairs, 1, 1000000,
      "meshes that can still move, a pool and a slot file: for another one the mesh that has not moved for "
      "longest is fixed for good; a replay takes no more than its mission has");
  keys.integer("rebuild_meshes", config.rebuild_meshes, 1, 10000, "meshes fused again per pair");
  std::string folder = config.slot_folder.string();
  keys.text("slot_folder", folder, "of the slot files; empty: beside the output");
  config.slot_folder = folder;
}

constexpr std::array<const char*, 3> kProfiles{"small", "usual", "large"};

// What a profile changes; the usual one is what the configurations have.
struct ProfileValues {
  std::size_t budget_mib, heap_mib, checkpoint_mib;
  int corners, max_level, tiles, keyframes, features;
  double keyframe_overlap;
  int closures, place_tries, predictions, rebuilt;
};
constexpr ProfileValues kSmall{576, 72, 64, 500, 6, 4096, 4000, 400, 0.6, 1, 2, 24, 3},
    kLarge{1536, 128, 256, 1600, 7, 32768, 16000, 1000, 0.8, 4, 8, 96, 12};

void take(const ProfileValues& values, OnboardConfig& c) {
  constexpr std::size_t kMib = 1 << 20;
  c.live.memory.budget_bytes = values.budget_mib * kMib;
  c.live.memory.heap_bytes = values.heap_mib * kMib;
  c.live.checkpoint_bytes = values.checkpoint_mib * kMib;
  c.stereo.max_features = values.corners;
  c.map.max_level = values.max_level;
  c.map.max_tiles = values.tiles;
  c.rebuild_meshes = values.rebuilt;
  LocalisationConfig& slam = c.localisation;
  slam.max_keyframes = values.keyframes;
  slam.graph.max_links = 2 * values.keyframes;
  slam.graph.max_fixes = values.keyframes / 2;
  slam.features = values.features;
  slam.keyframe_overlap = values.keyframe_overlap;
  slam.closures_per_keyframe = values.closures;
  slam.place_tries = values.place_tries;
  slam.predictions_per_keyframe = values.predictions;
}

}  // namespace

OnboardConfig::OnboardConfig() {
  map.max_level = 6;  // cells down to 3.1 cm where points are dense enough
  map.max_tiles = 8192;
}

void visitOnboard(KeyVisitor& keys, OnboardConfig& c, const io::MissionConfig& mission) {
  keys.table("computer", "what the others are by default, but for those that a file sets itself", [&] {
    const Profile before = c.profile;
    keys.choiceOf("profile", c.profile, kProfiles,
                  "small: four slow cores and 4 GiB; large: twice the points");
    if (c.profile != before) take(c.profile == Profile::kSmall ? kSmall : kLarge, c);
  });
  visitLive(keys, c.live, mission);
  keys.table("stereo", "", [&] { stereo::visitSparseStereo(keys, c.stereo); });
  keys.table("lighting", "", [&] { lighting::visitLighting(keys, c.lighting); });
  keys.table("map", "quadtree of heights", [&] { visitMap(keys, c.map); });
  keys.table("link", "what is sent to the ship", [&] {
    visitLink(keys, c.link);
    keys.text(
        "key_file", c.key_file,
        "the downlink's key, beside this file, as fathom-monitor key makes it; empty: requests are refused");
  });
  c.link.root_size = c.map.root_size;
  c.link.max_level = c.map.max_level;
  keys.table("slam", "keyframes, closures and what moves with them", [&] { visitSlam(keys, c); });
  keys.table("sensors", "standard deviations of the navigation sensors, the same topside",
             [&] { slam::visitSensorNoise(keys, c.localisation.graph.noise); });
  keys.table("nav", "dead reckoning", [&] {
    keys.number("drift_share", c.drift_share, "1", 0, 1,
                "growth of the position's standard deviation with distance, where there is no keyframe");
    keys.number("max_pair_skew_s", c.max_pair_skew, "s", 1e-4, 0.5,
                "largest difference of a pair's exposures");
    keys.number("max_dvl_gap_s", c.reckoning.max_dvl_gap, "s", 0.1, 60,
                "without bottom track before the velocity decays");
    keys.number("max_speed_mps", c.reckoning.max_speed, "m/s", 0.1, 20, "a faster bottom track is rejected");
    keys.number("max_turn_rate_radps", c.reckoning.max_turn_rate, "rad/s", 0.1, 10,
                "a heading that turns faster has leapt");
  });
  keys.table("output", "", [&] {
    keys.number("odometry_interval_s", c.odometry_interval, "s", 0.01, 60, "between rows of odometry.csv");
    keys.number("health_interval_s", c.health_interval, "s", 0.1, 60, "between rows of health.csv");
  });
}

OnboardConfig readOnboardConfig(const std::optional<std::filesystem::path>& path,
                                const io::MissionConfig& mission) {
  OnboardConfig config;
  ConfigReader keys(path ? ConfigTable::load(*path) : ConfigTable::parse("", ""));
  visitOnboard(keys, config, mission);
  keys.finish();
  if (!path) return config;
  if (!config.key_file.empty())
    config.link_key = telemetry::readLinkKey(path->parent_path() / config.key_file, config.warning);
  try {
    config.link.validate();
  } catch (const std::invalid_argument& e) {
    throw InputError(path->string(), "[link]", e.what());
  }
  std::ifstream in(*path);
  config.text.assign(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  return config;
}

std::string onboardToml(const OnboardConfig& config, const io::MissionConfig& mission) {
  return configToml(config, readOnboardConfig(std::nullopt, mission),
                    [&](KeyVisitor& keys, OnboardConfig& c) { visitOnboard(keys, c, mission); });
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
  noise = slam::withTide(noise, readTide(mission.tide_model, mission.start_utc_ns).has_value());
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

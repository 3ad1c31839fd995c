#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "firmware_if/mission/mission.hpp"
#include "realtime/onboard/link/link_core.hpp"
#include "realtime/onboard/live/live_config.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "realtime/onboard/nav/nav_core.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::onboard {

// The vehicle's computer: what keys are by default, but for those that a file sets itself.
enum class Profile : std::uint8_t { kSmall, kUsual, kLarge };

// Everything that fathom-onboard's configuration file can set.
struct OnboardConfig {
  OnboardConfig();

  Profile profile = Profile::kUsual;
  stereo::SparseStereoConfig stereo;
  lighting::LightingConfig lighting{.memory = lighting::kOnboardMemory};
  fusion::QuadtreeConfig map;
  LinkCoreConfig link;
  LocalisationConfig localisation;
  int max_pairs = 36000;              // stereo pairs whose meshes are kept: five hours at 2 Hz
  int rebuild_meshes = 6;             // fused again per pair when keyframes have moved
  std::filesystem::path slot_folder;  // of the slot files; empty: beside the output
  double drift_share = 0.01;    // of the distance travelled: growth of the position's standard deviation
  double max_pair_skew = 0.02;  // between the exposures of a stereo pair [s]
  nav::DeadReckoningConfig reckoning;          // gates of DVL and compass; the rest is the mission's
  double odometry_interval = 0.1;              // between rows of odometry.csv [s]
  double health_interval = 1.0;                // between rows of health.csv [s]
  std::string key_file;                        // link.key_file
  std::optional<telemetry::LinkKey> link_key;  // of link.key_file; absent: requests are refused
  LiveConfig live;                             // devices, recorder, real time, memory
  std::string warning;                         // about the key file, or ""
  std::string text;                            // of the file, verbatim
  std::optional<Eigen::Matrix3d> colours;      // of the left camera: not the file's, by the caller
};

// Without a path: the defaults. Throws InputError for an unknown key or a value out of range.
// `mission`: what device tables take their defaults from.
[[nodiscard]] OnboardConfig readOnboardConfig(const std::optional<std::filesystem::path>& path,
                                              const io::MissionConfig& mission = {});

// Every key. A reader sets what follows from others.
void visitOnboard(KeyVisitor& keys, OnboardConfig& config, const io::MissionConfig& mission);
// The configuration as onboard.toml: each key with its unit, range, default and meaning.
[[nodiscard]] std::string onboardToml(const OnboardConfig& config, const io::MissionConfig& mission);

// The cores' own configurations for one mission.
[[nodiscard]] NavCoreConfig navCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission);
[[nodiscard]] MapCoreConfig mapCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission,
                                          const StereoRig& rig);
[[nodiscard]] LinkCoreConfig linkCoreConfig(const OnboardConfig& config, const io::MissionConfig& mission);

}  // namespace fathom::onboard

#pragma once

#include <filesystem>
#include <string>

#include "realtime/base/config_keys.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/config/model_settings.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// Everything that can be set about a run.
struct TopsideConfig {
  lighting::LightingConfig lighting;
  int lighting_images = 100;  // pairs that the lighting model learns from, spread over the mission

  stereo::SparseStereoConfig stereo;
  bool dense_stereo = false;  // semi-global matching instead of corners
  stereo::DenseStereoConfig dense;
  bool mend_rig = true;  // where matches are off their epipolar lines, the rig as the dive shows it
  int min_points = 20;   // a pair with fewer stereo points is left out

  bool slam = true;                   // loop closures and visual odometry; false: dead reckoning
  bool bundle = true;                 // bundle adjustment after them
  int slam_features = 400;            // of a pair, for these
  int slam_candidates = 6;            // closures tried, for each pair at the mean
  slam::NavigationConfig navigation;  // what the navigation sensors are worth

  fusion::VolumetricConfig fusion;
  double min_component = 0.05;  // smaller pieces of the final mesh that touch nothing are dropped [m^2]

  ModelSettings model;

  double max_dvl_gap = 2.0;       // [s]
  double max_speed = 3.0;         // [m/s]
  double default_altitude = 2.0;  // seeds stereo where the DVL has none [m]

  double pairing_tolerance = 0.05;  // left and right of one pair, after time offsets [s]
  int threads = 0;                  // 0: all cores; the result does not depend on it
};

// Reads a TOML file over the defaults. Throws InputError: unknown key, wrong type, out of range.
[[nodiscard]] TopsideConfig readTopsideConfig(const std::filesystem::path& path);
// Every key. A reader sets what follows from others.
void visitTopside(KeyVisitor& keys, TopsideConfig& config);
// The configuration as such a file: each key with its unit, range, default and meaning.
[[nodiscard]] std::string topsideToml(const TopsideConfig& config);

// Settings that the results of several stages depend on, into their keys. What is new in one of these
// structures belongs there too: their sizes are checked.
void addNavigationSettings(Hasher& hasher, const TopsideConfig& config);
void addStereoSettings(Hasher& hasher, const TopsideConfig& config);
void addModelSettings(Hasher& hasher, const TopsideConfig& config);

// Sets the voxel and what follows from it: band of three voxels, border of five.
void setVoxel(TopsideConfig& config, double voxel);

}  // namespace fathom::topside

#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "firmware_if/mission.hpp"
#include "recon/closure/registration.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/stages/image_pairs.hpp"
#include "recon/topside/stages/lighting_stage.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/stages/pose_network.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// What simultaneous localisation and mapping made of a mission.
struct SlamResult {
  std::vector<NavigatedPose> poses;  // as navigation gave them, where they could be: improved
  std::vector<CameraLink> odometry;  // between consecutive pairs
  std::vector<CameraLink> closures;  // others, by pair
  std::size_t frames = 0;            // pairs with features
  std::size_t tried = 0;             // candidates for closures
  std::array<std::size_t, closure::kRefusals> refused{};  // of these, by cause
  std::vector<std::pair<std::string, double>> stage_seconds;
  double moved_rms = 0;  // horizontal, of the poses against dead reckoning [m]
};

// Visual odometry between consecutive pairs, then loop closures: candidates by the probability that
// footprints overlap, most valuable first, registered by features, in rounds: each round's poses say where
// the next one looks. The shape that solveNetwork gives is then placed by the position fixes, as navigation
// places dead reckoning. The result does not depend on the number of threads.
[[nodiscard]] SlamResult localise(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                  const StereoRig& rig, const TopsideConfig& config,
                                  const LightingModels& lighting, const PairList& list,
                                  const Navigation& navigation);

}  // namespace fathom::topside

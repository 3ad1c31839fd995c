#pragma once

#include <vector>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/input/navigation.hpp"

namespace fathom::topside {

// One model a camera.
struct LightingModels {
  LightingModels(const io::MissionConfig& mission, const StereoRig& rig,
                 const lighting::LightingConfig& config);
  lighting::LightingModel left, right;
  std::uint64_t unreadable = 0;  // images passed over
};

// The pairs that lighting is learnt from: config.lighting_images spread evenly over so many.
[[nodiscard]] std::vector<std::size_t> lightingPairs(std::size_t pairs, const TopsideConfig& config);

// Learns from config.lighting_images pairs spread evenly over the mission, by their ranges (bent to stereo's
// points; `poses`: one a pair), and shows its progress. Reads in parallel, learns in the pairs' order, so
// that the result does not depend on the number of threads.
void learnLighting(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                   const std::vector<ImagePair>& pairs, const std::vector<NavigatedPose>& poses,
                   const TopsideConfig& config, LightingModels& models);

}  // namespace fathom::topside

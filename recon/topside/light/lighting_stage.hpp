#pragma once

#include <memory>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// One model a camera.
struct LightingModels {
  LightingModels(const MissionInput& input, const lighting::LightingConfig& config);
  lighting::LightingModel left, right;
  std::vector<std::unique_ptr<lighting::LightingModel>> colour;  // of the colour cameras
  [[nodiscard]] const lighting::LightingModel& of(std::size_t camera) const {
    return camera == 0 ? left : camera == 1 ? right : *colour[camera - 2];
  }
  [[nodiscard]] lighting::LightingModel& of(std::size_t camera) {
    return camera == 0 ? left : camera == 1 ? right : *colour[camera - 2];
  }
  std::uint64_t unreadable = 0;  // images passed over
};

// The pairs that lighting is learnt from: config.lighting_images spread evenly over so many.
[[nodiscard]] std::vector<std::size_t> lightingPairs(std::size_t pairs, const TopsideConfig& config);

// `survey`: the content of its result.
[[nodiscard]] Digest lightingKey(const MissionInput& input, const TopsideConfig& config, const Digest& survey,
                                 const std::vector<Digest>& image_identities);
void saveLighting(WorkFileWriter& file, const LightingModels& models);
void loadLighting(const WorkFile& file, LightingModels& models);  // throws DamagedWork

// Learns from config.lighting_images pairs spread evenly over the mission, by their ranges (bent to stereo's
// points), and shows its progress. Reads in parallel, learns in the pairs' order, so
// that the result does not depend on the number of threads.
void learnLighting(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                   LightingModels& models);

}  // namespace fathom::topside

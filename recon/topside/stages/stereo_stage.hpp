#pragma once

#include <optional>

#include "firmware_if/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/stages/lighting_stage.hpp"
#include "recon/topside/stages/pair_images.hpp"
#include "recon/topside/stages/pair_mesher.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// Reads, corrects, matches and triangulates one pair. One object a thread; the result depends on the pair
// alone.
class StereoStage final : public PairMesher {
 public:
  StereoStage(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
              const TopsideConfig& config, const LightingModels& models);

  [[nodiscard]] PairResult process(const ImagePair& pair, const SE3& T_nav_body, double altitude) override;

 private:
  const io::MissionConfig& mission_;
  const TopsideConfig& config_;
  PairImages images_;
  stereo::SparseStereo sparse_;
  std::optional<stereo::DenseStereo> dense_;  // if configured, instead
};

}  // namespace fathom::topside

#pragma once

#include "firmware_if/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/given_stereo.hpp"
#include "recon/topside/stages/pair_mesher.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// The mesh of a pair of a mission without images: from its feature file.
class GivenPairStage final : public PairMesher {
 public:
  GivenPairStage(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                 const TopsideConfig& config);
  [[nodiscard]] PairResult process(const ImagePair& pair, const SE3& T_nav_body, double altitude) override;

 private:
  const io::MissionPaths& paths_;
  const io::MissionConfig& mission_;
  const TopsideConfig& config_;
  stereo::GivenStereo stereo_;
  StereoFeatureFrame frame_;
};

}  // namespace fathom::topside

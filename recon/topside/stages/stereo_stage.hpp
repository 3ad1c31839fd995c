#pragma once

#include <optional>
#include <string>

#include "firmware_if/mission.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/stage_times.hpp"
#include "recon/topside/stages/image_pairs.hpp"
#include "recon/topside/stages/lighting_stage.hpp"
#include "recon/topside/stages/pair_images.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// What became of one pair.
struct PairResult {
  std::string unreadable;  // the error's line, if an image could not be read
  Mesh mesh;               // in nav; empty if there were too few points
  SE3 T_nav_cam;
  std::size_t points = 0;
  std::uint32_t corners = 0;
  stereo::StereoResult::Rejected rejected;
  double footprint_radius = 0;  // of the mesh about its middle, in plan [m]
  PairTimes times;
};

// Reads, corrects, matches and triangulates one pair. One object a thread; the result depends on the pair
// alone.
class StereoStage {
 public:
  StereoStage(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
              const TopsideConfig& config, const LightingModels& models);

  // `T_nav_body` at the exposure; `altitude` of the DVL above the bottom [m].
  [[nodiscard]] PairResult process(const ImagePair& pair, const SE3& T_nav_body, double altitude);

 private:
  const io::MissionConfig& mission_;
  const TopsideConfig& config_;
  PairImages images_;
  stereo::SparseStereo sparse_;
  std::optional<stereo::DenseStereo> dense_;  // if configured, instead
};

}  // namespace fathom::topside

#pragma once

#include <memory>
#include <string>

#include "recon/closure/frame_features.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/light/lighting_stage.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {

// All that is taken from a pair before its place is known.
struct PreparedPair {
  std::string unreadable;           // the error's line, if an image could not be read
  closure::FrameFeatures features;  // for localisation
  Mesh mesh;           // left camera frame, with sigma and colours; empty if there were too few points
  bool unlit = false;  // its strobes stayed dark: no colours
  std::size_t points = 0;
  std::uint32_t corners = 0;
  stereo::StereoResult::Rejected rejected;
  PairTimes times;
};

// Reads a pair once and takes from it what later stages need. One object a thread; the result depends on the
// pair and its seed plane alone.
class PairPreparer {
 public:
  virtual ~PairPreparer() = default;
  [[nodiscard]] virtual PreparedPair process(const ImagePair& pair, const stereo::SeedPlane& plane) = 0;
};

// From images, or, of a mission without them, from its feature files; features only if the pairs are
// `localised`. All references must outlive it.
[[nodiscard]] std::unique_ptr<PairPreparer> makePreparer(const MissionInput& input,
                                                         const TopsideConfig& config,
                                                         const LightingModels& lighting, bool localised);

}  // namespace fathom::topside

#pragma once

#include <memory>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/light/lighting_stage.hpp"
#include "recon/topside/localise/feature_store.hpp"
#include "recon/topside/work/stage_times.hpp"

namespace fathom::topside {

// All that is taken from a pair before its place is known.
struct PreparedPair {
  std::string unreadable;           // the error's line, if an image could not be read
  closure::FrameFeatures features;  // for localisation, if asked for
  Mesh mesh;  // left camera frame, with sigma and colours; empty if there were too few points
  std::size_t points = 0;
  std::uint32_t corners = 0;
  stereo::StereoResult::Rejected rejected;
  PairTimes times;
};

// What is wanted of a pair.
struct Wanted {
  bool features = true, mesh = true;
};

// Reads a pair once and takes from it what later stages need. One object a thread; the result depends on the
// pair, `T_nav_body` (whose attitude places the seed plane) and `altitude` [m] alone.
class PairPreparer {
 public:
  virtual ~PairPreparer() = default;
  [[nodiscard]] virtual PreparedPair process(const ImagePair& pair, const SE3& T_nav_body,
                                             double altitude) = 0;
};

// From images, or, of a mission without them, from its feature files. All references must outlive it.
[[nodiscard]] std::unique_ptr<PairPreparer> makePreparer(const io::MissionPaths& paths,
                                                         const io::MissionConfig& mission,
                                                         const StereoRig& rig, const TopsideConfig& config,
                                                         const LightingModels& lighting, bool features_only,
                                                         Wanted wanted);

// The features of every pair with a pose, in memory. The result does not depend on the number of threads.
[[nodiscard]] MemoryFeatureStore prepareFeatures(const io::MissionPaths& paths,
                                                 const io::MissionConfig& mission, const StereoRig& rig,
                                                 const TopsideConfig& config, const LightingModels& lighting,
                                                 const PairList& list, const Navigation& navigation);

}  // namespace fathom::topside

#pragma once

#include <mutex>
#include <vector>

#include "firmware_if/mission.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/progress.hpp"
#include "recon/topside/stages/image_pairs.hpp"
#include "recon/topside/stages/lighting_stage.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

// A progress bar that several threads advance.
class SharedProgress {
 public:
  SharedProgress(const char* stage, std::size_t steps) : progress_(stage, steps) {}
  void step() {
    const std::lock_guard lock(mutex_);
    progress_.step();
  }

 private:
  std::mutex mutex_;
  Progress progress_;
};

// The pairs that have a pose, by time; of some that cannot be read or show nothing, features are empty.
struct Frames {
  std::size_t with_features = 0;
  std::vector<std::uint32_t> pair;  // index of the mission's pair
  std::vector<closure::FrameFeatures> features;
  std::vector<SE3> reckoned;     // T_nav_cam
  std::vector<double> altitude;  // of the camera over the seafloor [m]
  std::vector<double> way;       // flown up to it [m]
};

// Features of every pair: extracted from its images, or, of a mission without images, read. A pair that
// cannot be read has none. The result does not depend on the number of threads.
[[nodiscard]] Frames extractFeatures(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                     const StereoRig& rig, const TopsideConfig& config,
                                     const LightingModels& lighting, const PairList& list,
                                     const Navigation& navigation);

}  // namespace fathom::topside

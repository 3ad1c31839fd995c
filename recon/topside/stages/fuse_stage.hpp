#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/topside/progress.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/stages/pair_mesher.hpp"

namespace fathom::topside {

// One pair that has a pose: what the report and the pose files need of it.
struct FusedPair {
  ImagePair pair;
  SE3 T_nav_body, T_nav_cam;
  double altitude = 0;  // of the DVL [m], 0 unknown
  double footprint_radius = 0;
  std::size_t points = 0;
  bool used = false;  // its mesh is in the map
};

struct FuseCounts {
  std::size_t without_pose = 0;  // outside the recorded navigation
  std::size_t unreadable = 0, too_few_points = 0, used = 0;
  std::uint64_t points = 0, corners = 0;
  stereo::StereoResult::Rejected rejected;
  std::vector<std::string> unreadable_lines;  // the first few errors
  PairTimes times;                            // summed over pairs
};

struct FuseResult {
  std::vector<FusedPair> pairs;  // readable pairs with a pose, by time
  FuseCounts counts;
};

// Stereo of all pairs in parallel, fusion one after the other in their order: the same map for any number of
// threads. No more pairs than twice the threads are in memory at once.
[[nodiscard]] FuseResult fusePairs(const std::vector<ImagePair>& pairs,
                                   const std::vector<NavigatedPose>& poses,
                                   const std::function<std::unique_ptr<PairMesher>()>& make_stage,
                                   double default_altitude, fusion::VolumetricFusion& fusion,
                                   Progress& progress);

}  // namespace fathom::topside

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {

// One readable pair that has a pose: what the report and the pose files need of it.
struct FusedPair {
  ImagePair pair;
  SE3 T_nav_body, T_nav_cam;
  double altitude = 0;  // of the DVL, or by the images where nothing else navigates [m], 0 unknown
  double range = 0;     // of the seed plane [m]
  double footprint_radius = 0;
  std::size_t points = 0;
  bool used = false;       // its mesh is in the map
  std::uint32_t part = 0;  // of those that nothing joins: see SlamResult::Part
};

struct FuseCounts {
  std::size_t without_pose = 0;  // outside the recorded navigation; without any: too bare for localisation
  std::size_t unreadable = 0, too_few_points = 0, used = 0;
  std::uint64_t points = 0, corners = 0;
  stereo::StereoResult::Rejected rejected;
  std::vector<std::string> unreadable_lines;  // their errors
};

struct FuseResult {
  std::vector<FusedPair> pairs;  // by time
  FuseCounts counts;
};

}  // namespace fathom::topside

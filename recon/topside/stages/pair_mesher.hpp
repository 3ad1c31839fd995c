#pragma once

#include <string>

#include "recon/geometry/mesh.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/stage_times.hpp"
#include "recon/topside/stages/image_pairs.hpp"

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

// Makes the mesh of one pair at a time. One object a thread; the result depends on the pair alone.
class PairMesher {
 public:
  virtual ~PairMesher() = default;
  // `T_nav_body` at the exposure; `altitude` of the DVL above the bottom [m].
  [[nodiscard]] virtual PairResult process(const ImagePair& pair, const SE3& T_nav_body, double altitude) = 0;
};

// Radius of a circle around the middle of the mesh's box, in plan [m]; 0 for none.
[[nodiscard]] double footprintRadius(const Mesh& mesh);

}  // namespace fathom::topside

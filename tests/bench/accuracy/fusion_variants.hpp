#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "sim/score/score.hpp"

namespace fathom::accuracy {

// One surface fused from the same pairs, with a part of what limits it replaced by the truth.
struct Variant {
  std::string name;
  Mesh mesh;
  sim::SurfaceScore score;
};

// Errors of the measured stereo points along their lines of sight, measured less true [m].
struct PointErrors {
  std::size_t points = 0, beyond_limit = 0;  // beyond kLimit: mismatches and moving things
  double rms = 0, mean = 0;                  // of the others
  double rms_over_sigma = 0;                 // of the others, by what each claims
  static constexpr double kLimit = 0.10;
};

struct VariantReport {
  std::vector<Variant> variants;
  PointErrors points;
  double pose_rms = 0;       // of the estimated camera positions after alignLevel [m]
  double triangle_edge = 0;  // mean, of the local meshes [m]
};

// Runs the pipeline's own stereo over a simulated mission with images, and fuses every pair's mesh five
// times:
//   measured points, estimated poses    what the pipeline gives
//   measured points, true poses         without the errors of localisation
//   true points, estimated poses        without the errors of stereo
//   true points, true poses             the oracle: sparse triangles and voxels are left
//   dense true points, true poses       a point every half voxel or so: voxels alone are left
// A true point is where the measured point's line of sight meets the true surface. `poses`: a
// stereo_pose_est.data. Throws InputError for a mission without truth or images.
[[nodiscard]] VariantReport fuseVariants(const std::filesystem::path& mission,
                                         const std::filesystem::path& poses,
                                         const topside::TopsideConfig& config);

}  // namespace fathom::accuracy

#pragma once

#include <utility>
#include <vector>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/fusion/space_division.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/plan/ground_light.hpp"

#include "recon/topside/prepare/prepared_groups.hpp"

namespace fathom::topside {

// How the dive is divided, and what is known of it before anything is fused.
struct ModelPlan {
  std::vector<fusion::MeshFootprint> footprints;  // of every pair's mesh; empty ones of pairs without
  std::vector<fusion::Piece> pieces;
  fusion::CellStatistics statistics;
  GroundLight light;  // what overlapping images say of each other's
  double texel = 0;   // finest [m]
};

// Poses of the left camera of every pair with a mesh; identity elsewhere.
[[nodiscard]] std::vector<SE3> cameraPoses(const std::vector<NavigatedPose>& poses, const SE3& T_body_cam);

// Reads every mesh once, in parallel; the result does not depend on the number of threads. `lighting`: of
// the left camera; `region`: only pieces that may meet it; null: all. Throws InputError where there is none.
[[nodiscard]] ModelPlan planModel(const PreparedGroups& prepared, const lighting::LightingModel& lighting,
                                  const std::vector<SE3>& T_nav_cam,
                                  const std::vector<slam::NavigationLink>& closures, const TileGrid& grid,
                                  const fusion::DivisionConfig& division, const Region* region);

// A pixel's edge on the ground from the dive's middle altitude, in steps of 0.1 mm [m].
[[nodiscard]] double nativeTexel(const Camera& camera, const SeedPlanes& planes, double default_range);

// `poses`, `prepared`: the contents of these results.
[[nodiscard]] Digest planKey(const MissionInput& input, const TopsideConfig& config, const TileGrid& grid,
                             const Digest& poses, const Digest& prepared);
void savePlan(WorkFileWriter& file, const ModelPlan& plan);
[[nodiscard]] ModelPlan loadPlan(const WorkFile& file);  // throws DamagedWork

}  // namespace fathom::topside

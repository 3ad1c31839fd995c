#pragma once

#include <cstdint>
#include <set>
#include <utility>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/score/alignment.hpp"
#include "sim/score/score.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::sim {

// Squares of seafloor in plan, by their number north and east.
using PlanCells = std::set<std::pair<std::int32_t, std::int32_t>>;
constexpr double kPlanCell = 0.10;  // edge [m]

// `count` points spread evenly over the area of a mesh; always the same for the same mesh.
[[nodiscard]] Points sampleSurface(const Mesh& mesh, std::size_t count);

// What a camera saw of the true surface from its poses.
struct SeenSeafloor {
  PlanCells cells;
  Points points;  // of these, spread over the poses and their images
};
[[nodiscard]] SeenSeafloor seenSeafloor(const TruthSurface& truth, const Camera& camera,
                                        const std::vector<SE3>& T_nav_cam);
// The squares that hold a piece of the mesh after `motion`.
[[nodiscard]] PlanCells meshCells(const Mesh& mesh, const SE3& motion);

// `start`: where the alignment begins, from the trajectory; identity when there is none.
[[nodiscard]] SurfaceScore scoreSurface(const Mesh& estimate, const TruthSurface& truth,
                                        const SeenSeafloor& seen, const SE3& start);

}  // namespace fathom::sim

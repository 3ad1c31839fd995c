#pragma once

#include <array>
#include <cstdint>
#include <functional>
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

// Calls visit(triangle, u, v, point) for `count` points spread evenly over the area of a mesh, always the
// same for the same mesh; point = a + u (b - a) + v (c - a).
void forSurface(const Mesh& mesh, std::size_t count,
                const std::function<void(const std::array<std::uint32_t, 3>& triangle, double u, double v,
                                         const Eigen::Vector3d& point)>& visit);
// These points.
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

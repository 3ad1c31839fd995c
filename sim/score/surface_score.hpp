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
#include "sim/score/score.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::sim {

// Squares of seafloor in plan, by their indices north and east.
using PlanCells = std::set<std::pair<std::int32_t, std::int32_t>>;
constexpr double kPlanCell = 0.10;  // edge [m]

// Calls visit(triangle, u, v, point) for `count` points spread evenly over the area of a mesh, always the
// same for the same mesh; point = a + u (b - a) + v (c - a).
void forSurface(const Mesh& mesh, std::size_t count,
                const std::function<void(const std::array<std::uint32_t, 3>& triangle, double u, double v,
                                         const Eigen::Vector3d& point)>& visit);
// The points of forSurface().
[[nodiscard]] Points sampleSurface(const Mesh& mesh, std::size_t count);

// The part of the true surface seen by a camera from its poses.
struct VisibleSeafloor {
  PlanCells cells;
  Points points;  // samples, spread over the poses and their images
};
[[nodiscard]] VisibleSeafloor visibleSeafloor(const TruthSurface& truth, const Camera& camera,
                                              const std::vector<SE3>& T_nav_cam);
// The squares that contain a part of the mesh after `motion`.
[[nodiscard]] PlanCells meshCells(const Mesh& mesh, const SE3& motion);

// `start`: initial alignment, from the trajectory; identity without one.
[[nodiscard]] SurfaceScore scoreSurface(const Mesh& estimate, const TruthSurface& truth,
                                        const VisibleSeafloor& seen, const SE3& start);

}  // namespace fathom::sim

#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::sim {

using Points = std::vector<Eigen::Vector3d>;

// The rigid motion T_truth_estimate that takes `estimate` nearest to `truth`, point by point (Umeyama 1991,
// without scale). Identity without points.
[[nodiscard]] SE3 alignRigid(const Points& estimate, const Points& truth);
// The same with rotation about the vertical only, which is well-conditioned for points near a line.
[[nodiscard]] SE3 alignLevel(const Points& estimate, const Points& truth);

// The rigid motion that takes points of an estimated surface onto the true one: point-to-plane ICP from
// `start`, rejecting points farther away than three times the median distance. Never worse than the start.
[[nodiscard]] SE3 alignSurface(const Points& estimate, const TruthSurface& truth, const SE3& start);

}  // namespace fathom::sim

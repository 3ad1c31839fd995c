#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::slam {

// A measured relative pose T_from_to between two poses of a graph.
struct RelativePose {
  int from = 0, to = 0;  // indices of poses
  SE3 T_from_to;
  Matrix6d information = Matrix6d::Identity();  // of the residual below
};

// Poses T_world_pose and what was measured between them.
struct PoseGraph {
  std::vector<std::int64_t> ids;  // names of the poses in a file
  std::vector<SE3> poses;
  std::vector<RelativePose> edges;
};

// Residual of a relative pose, as g2o (Kuemmerle et al. 2011) defines it for EDGE_SE3:QUAT:
//   E = T_from_to^-1 T_w_from^-1 T_w_to,   e = [translation of E; vector part of E's quaternion, w >= 0]
// so that chi2 = sum e^T information e compares with what others report.
// The vector part is half a small rotation.
[[nodiscard]] Vector6d relativePoseError(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to);

// The same with its derivatives by right perturbations of both poses (uncertain_pose.hpp).
struct RelativePoseLinear {
  Vector6d error;
  Matrix6d by_from, by_to;
};
[[nodiscard]] RelativePoseLinear linearize(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to);

// Whether a symmetric information matrix is positive semidefinite, to rounding; and the nearest one that is
// (by the sum of squared differences; Higham 1988: negative eigenvalues become zero).
[[nodiscard]] bool isPositive(const Matrix6d& information);
[[nodiscard]] Matrix6d nearestPositive(const Matrix6d& information);

// Information of the residual, whose last three numbers are half angles,
// from that of the right perturbation of T_from_to.
[[nodiscard]] Matrix6d residualInformation(const Matrix6d& of_perturbation);

// chi2 of all edges.
[[nodiscard]] double chiSquare(const PoseGraph& graph);

}  // namespace fathom::slam

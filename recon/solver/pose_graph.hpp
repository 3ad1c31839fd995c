#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string_view>
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

// Reads a 3D pose graph in g2o's text form: lines VERTEX_SE3:QUAT id x y z qx qy qz qw and EDGE_SE3:QUAT from
// to x y z qx qy qz qw and the upper triangle of the 6 x 6 information, row by row. Poses are in rising order
// of id. FIX lines and comments (#) are passed over. An edge to an id without a vertex, a vertex given twice,
// any other line, a number that is not finite or a quaternion of length zero is an InputError with file and
// line. So is an information matrix that is not positive semidefinite, unless `made_positive` is given: then
// the nearest one that is (pose_graph.hpp) takes its place, and they are counted there.
[[nodiscard]] PoseGraph readG2o(const std::filesystem::path& path, int* made_positive = nullptr);
// The same from text; `name` stands for the file in error lines.
[[nodiscard]] PoseGraph parseG2o(std::string_view text, const std::string& name,
                                 int* made_positive = nullptr);

// Writes the same; to a temporary name, then renamed.
void writeG2o(const std::filesystem::path& path, const PoseGraph& graph);

}  // namespace fathom::slam

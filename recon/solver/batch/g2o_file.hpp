#pragma once

#include <filesystem>
#include <string_view>

#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

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

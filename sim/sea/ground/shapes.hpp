#pragma once

#include <cstdint>

#include "sim/sea/ground/surface_scene.hpp"

namespace fathom::sim {

// Closed surfaces about their own origin, z down, normals outwards. Same seed, same shape. `edge_m`:
// approximate length of the triangles' edges.

// An angular stone, broken rather than round; `size_m` is its longest diameter.
[[nodiscard]] TriangleSurface makeStone(std::uint64_t seed, double size_m, double edge_m);
// A coral head: a knobbly cap of diameter `size_m` on a foot that is thinner by the fraction `overhang`; the
// origin is where the foot enters the seafloor.
[[nodiscard]] TriangleSurface makeCoralHead(std::uint64_t seed, double size_m, double overhang,
                                            double edge_m);

// Rotates, then translates a surface.
void place(TriangleSurface& surface, const Eigen::Matrix3f& rotation, const Eigen::Vector3f& translation);

// Area-weighted normals of the vertices from the triangles.
void computeSurfaceNormals(TriangleSurface& surface);

}  // namespace fathom::sim

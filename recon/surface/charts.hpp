#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::surface {

// Faces that are projected together, along -`outwards`.
struct ChartFaces {
  std::vector<std::uint32_t> faces;  // ascending
  Eigen::Vector3d outwards;          // unit: mean normal, or straight up
};

// Divides a surface into few charts. All faces visible from above are one chart, connected or not; steep
// faces grow into charts about their mean normal, so that walls keep their resolution. Charts of few faces
// join a neighbour with a similar axis. No two faces of a chart cover the same texel centre of a lattice of
// `texel` [m].
[[nodiscard]] std::vector<ChartFaces> makeCharts(const Mesh& mesh, double texel);

// Directions of the texel lattice of a chart that is seen along -outwards: unit vectors `right` and `down`
// with right x down = -outwards; from above north is up, else the surface is.
struct ChartFrame {
  Eigen::Vector3d right, down;
};
[[nodiscard]] ChartFrame frameOf(const Eigen::Vector3d& outwards);

}  // namespace fathom::surface

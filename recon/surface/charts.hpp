#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::surface {

// Faces that are drawn together, along -`outwards`.
struct ChartFaces {
  std::vector<std::uint32_t> faces;  // ascending
  Eigen::Vector3d outwards;          // unit: mean normal, or straight up
};

// Divides a surface into few charts. All that can be looked at from above is one, wherever it lies; steep
// faces grow into charts of their own about their mean normal, so that walls keep their resolution. Charts of
// few faces join a neighbour that sees them well enough. No two faces of a chart cover the same texel centre
// of a lattice of `texel` [m].
[[nodiscard]] std::vector<ChartFaces> makeCharts(const Mesh& mesh, double texel);

// Directions of the texel lattice of a chart that is seen along -outwards: unit vectors `right` and `down`
// with right x down = -outwards; from above north is up, else the surface is.
struct ChartFrame {
  Eigen::Vector3d right, down;
};
[[nodiscard]] ChartFrame frameOf(const Eigen::Vector3d& outwards);

}  // namespace fathom::surface

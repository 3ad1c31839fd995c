#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {

// The surface at every kStep-th texel of every chart, where slowly varying quantities are computed before
// they are interpolated. Node (i, j) of a chart is its texel (kStep i, kStep j), cell (i, j) the kStep x
// kStep texels from there on; the outermost nodes may be outside the chart.
struct ChartLattice {
  static constexpr int kStep = 8;  // [texels]

  struct Grid {
    int columns = 0, rows = 0;  // nodes; cells: one less
    std::size_t first_node = 0, first_cell = 0;
    [[nodiscard]] std::size_t node(int i, int j) const {
      return first_node + static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) +
             static_cast<std::size_t>(i);
    }
    [[nodiscard]] std::size_t cell(int i, int j) const {
      return first_cell + static_cast<std::size_t>(j) * static_cast<std::size_t>(columns - 1) +
             static_cast<std::size_t>(i);
    }
  };

  explicit ChartLattice(const Atlas& atlas);

  Eigen::Vector3d origin;             // of the positions: about the tile's middle [m, nav]
  std::vector<Grid> grids;            // one a chart
  std::vector<float> x, y, z;         // of a node, relative to origin [m]
  std::vector<float> nx, ny, nz;      // its face's normal, unit length
  std::vector<std::uint8_t> known;    // of a node: it has a position, as have all nodes of covered cells
  std::vector<std::uint8_t> covered;  // of a cell: texels that show a face
  std::uint64_t texels = 0;           // that show a face
};
inline constexpr int kTexelStep = ChartLattice::kStep;

}  // namespace fathom::surface

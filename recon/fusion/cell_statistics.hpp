#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// Where a surface is seen how often, and how well those who saw it agree (Johnson-Roberson et al. 2010,
// figure 11): meshes and deviation of depth in square cells of nav's horizontal plane, made before fusion.
// Cells are summed, so that groups of meshes can be counted apart and merged; the result does not depend on
// the order but for rounding.
class CellStatistics {
 public:
  explicit CellStatistics(double cell = 0.10);  // edge [m]

  struct Cell {
    std::int32_t x = 0, y = 0;  // north, east, in cells (floor)
    std::uint32_t meshes = 0;
    double mean_z = 0;     // of each mesh's mean depth in the cell [m]
    double deviation = 0;  // standard deviation of these between meshes [m]; 0 for one mesh
  };

  // One mesh in nav: its triangles' surface, not its vertices, decides which cells it covers.
  void add(const Mesh& mesh);
  void merge(const CellStatistics& other);        // same cell size
  [[nodiscard]] std::vector<Cell> cells() const;  // by x, then y
  [[nodiscard]] double cell() const { return cell_; }

  // State, for keeping between runs.
  [[nodiscard]] std::vector<std::uint8_t> save() const;
  [[nodiscard]] bool load(const std::vector<std::uint8_t>& bytes);  // false: not such a state, unchanged

 private:
  struct Sums {
    std::int32_t x = 0, y = 0;
    std::uint32_t meshes = 0;
    double z = 0, zz = 0;
  };
  double cell_;
  std::vector<Sums> sums_;  // by x, then y
};

}  // namespace fathom::fusion

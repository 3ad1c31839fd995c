#pragma once

#include <cstddef>
#include <vector>

#include "recon/compare/plane_frame.hpp"

namespace fathom::compare {

// Heights (up, [m]) in square cells of a plane frame; the first row is the northernmost. NaN: unknown.
struct HeightMap {
  double west = 0, north = 0;  // of the top left corner [m]
  double cell = 1;             // [m]
  int columns = 0, rows = 0;
  std::vector<float> up;
  std::vector<float> sigma;  // standard deviation of `up`; empty if unknown

  HeightMap() = default;
  // All unknown; covers the box, with cell borders at multiples of the cell.
  HeightMap(const Box& box, double cell_m);

  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  [[nodiscard]] double eastOf(int column) const { return west + (column + 0.5) * cell; }
  [[nodiscard]] double northOf(int row) const { return north - (row + 0.5) * cell; }
  [[nodiscard]] Box box() const { return {west, north - rows * cell, west + columns * cell, north}; }
  [[nodiscard]] std::size_t known() const;
  // Between the four cells around a place; NaN where one of them is unknown.
  [[nodiscard]] double at(double east, double north_m) const;

  // Means of factor x factor cells, where at least half of them are known.
  [[nodiscard]] HeightMap coarser(int factor) const;
};

// The median of the known heights; NaN without any.
[[nodiscard]] double medianHeight(const HeightMap& map);

}  // namespace fathom::compare

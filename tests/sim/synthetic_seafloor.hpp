#pragma once

#include <cmath>

#include "recon/geometry/mesh.hpp"

namespace fathom::sim {

// A bumpy seafloor of 8 x 6 m at 10 m depth.
inline Mesh syntheticSeafloor(double spacing = 0.05) {
  Mesh mesh;
  const int rows = static_cast<int>(std::lround(8.0 / spacing)),
            columns = static_cast<int>(std::lround(6.0 / spacing));
  for (int i = 0; i <= rows; ++i) {
    for (int j = 0; j <= columns; ++j) {
      const double n = -4.0 + i * spacing, e = -3.0 + j * spacing;
      const double z = 10.0 + 0.3 * std::sin(1.3 * n) * std::cos(1.1 * e + 0.4) + 0.1 * std::sin(3.0 * e - n);
      mesh.vertices.emplace_back(static_cast<float>(n), static_cast<float>(e), static_cast<float>(z));
    }
  }
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      const auto at = [columns](int r, int c) { return static_cast<std::uint32_t>(r * (columns + 1) + c); };
      mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j)});
      mesh.triangles.push_back({at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)});
    }
  }
  return mesh;
}

}  // namespace fathom::sim

#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace fathom::test {

// The triangles of vertices that stand row by row, rows northwards and columns eastwards: normals up.
inline std::vector<std::array<std::uint32_t, 3>> latticeTriangles(int rows, int columns) {
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (int i = 0; i + 1 < rows; ++i)
    for (int j = 0; j + 1 < columns; ++j) {
      const auto a = static_cast<std::uint32_t>(i * columns + j), b = a + static_cast<std::uint32_t>(columns);
      triangles.push_back({a, a + 1, b + 1});
      triangles.push_back({a, b + 1, b});
    }
  return triangles;
}

}  // namespace fathom::test

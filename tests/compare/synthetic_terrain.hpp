#pragma once

#include <cmath>
#include <cstdint>

#include "recon/compare/height_map.hpp"

namespace fathom::test {

// Hills and hollows of several sizes, the same everywhere [m].
inline double roughHeight(double east, double north) {
  return -14.0 + 0.30 * std::sin(0.9 * east + 0.4 * north) + 0.25 * std::cos(0.7 * north - 0.5 * east) +
         0.12 * std::sin(2.3 * east - 1.1 * north + 1.0) + 0.08 * std::cos(1.7 * east + 2.9 * north);
}

// Noise of standard deviation about 1 that is the same for the same place and seed.
inline double noiseAt(int column, int row, std::uint64_t seed) {
  std::uint64_t h = seed * 0x9E3779B97F4A7C15ULL +
                    static_cast<std::uint64_t>(column + 100000) * 0xBF58476D1CE4E5B9ULL +
                    static_cast<std::uint64_t>(row + 100000) * 0x94D049BB133111EBULL;
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    h ^= h >> 31;
    h *= 0xD6E8FEB86659FD93ULL;
    h ^= h >> 29;
    sum += static_cast<double>(h >> 11) * 0x1.0p-53 - 0.5;
  }
  return sum * std::sqrt(3.0);
}

// Height(east, north) in the cells of a box, with noise [m].
template <typename Height>
compare::HeightMap mapOf(const compare::Box& box, double cell, const Height& height, double noise,
                         std::uint64_t seed) {
  compare::HeightMap map(box, cell);
  for (int row = 0; row < map.rows; ++row)
    for (int column = 0; column < map.columns; ++column)
      map.up[map.index(column, row)] = static_cast<float>(height(map.eastOf(column), map.northOf(row)) +
                                                          noise * noiseAt(column, row, seed));
  return map;
}

}  // namespace fathom::test

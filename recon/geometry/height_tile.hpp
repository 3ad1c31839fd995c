#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// A square of seafloor as heights on a regular lattice in nav: output of the map, input of the map codec.
// Node (i, j) is at north = north0() + i * spacing(), east = east0() + j * spacing(); the last row and
// column repeat the first of the neighbouring tiles, so that tiles of one level join without gaps.
struct HeightTile {
  static constexpr int kCells = 16;         // per side
  static constexpr int kSide = kCells + 1;  // nodes per side
  static constexpr int kNodes = kSide * kSide;

  struct Node {
    float depth = 0;     // nav z, down [m]
    float sigma = 0;     // standard deviation of depth [m]
    float coverage = 0;  // 0 (never measured: depth, sigma and colour mean nothing) to 1 (fully observed)
    Rgb colour{};
    bool layered = false;  // a second surface was measured above or below the one shown
  };

  std::int32_t north_index = 0;  // tile number northwards: the tile begins at north_index * size
  std::int32_t east_index = 0;
  std::int16_t level = 0;      // each level halves the size of the one before
  double size = 0;             // edge of the tile [m]
  std::uint32_t revision = 0;  // grows when the content changes
  std::array<Node, kNodes> nodes{};

  [[nodiscard]] double spacing() const { return size / kCells; }
  [[nodiscard]] double north0() const { return north_index * size; }
  [[nodiscard]] double east0() const { return east_index * size; }
  [[nodiscard]] Node& at(int i, int j) { return nodes[static_cast<std::size_t>(i * kSide + j)]; }
  [[nodiscard]] const Node& at(int i, int j) const { return nodes[static_cast<std::size_t>(i * kSide + j)]; }
};

}  // namespace fathom

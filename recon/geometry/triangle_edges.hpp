#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom {

// A side of a triangle is named by the corner at its start, 3 * triangle + k; it ends at the next one.
[[nodiscard]] constexpr std::uint32_t nextCorner(std::uint32_t corner) {
  return corner % 3 == 2 ? corner - 2 : corner + 1;
}

// Calls visit(sides) for every edge of the triangles with all sides that lie on it, ascending (in a
// std::vector<std::uint32_t>): one on a border, two inside, more where sheets meet. Edges by their lower
// vertex, then the higher.
template <typename Visit>
void visitEdges(std::span<const std::array<std::uint32_t, 3>> triangles, Visit&& visit) {
  struct Side {
    std::uint64_t edge;
    std::uint32_t corner;
    auto operator<=>(const Side&) const = default;
  };
  std::vector<Side> sides;
  sides.reserve(3 * triangles.size());
  for (const auto& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t a = t[k], b = t[(k + 1) % 3];
      sides.push_back({std::min(a, b) << 32 | std::max(a, b), static_cast<std::uint32_t>(sides.size())});
    }
  std::sort(sides.begin(), sides.end());
  std::vector<std::uint32_t> corners;
  for (std::size_t first = 0, last = 0; first < sides.size(); first = last) {
    corners.clear();
    while (last < sides.size() && sides[last].edge == sides[first].edge)
      corners.push_back(sides[last++].corner);
    visit(corners);
  }
}

}  // namespace fathom

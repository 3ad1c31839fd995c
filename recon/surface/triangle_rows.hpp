#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace fathom::surface {

// The texel centres (integer + 1/2) that a triangle covers, row by row: visit(row, first, last) for columns
// [first, last). Corners in texels with their `id`s: of two triangles at a side with the same ids and
// positions exactly one covers each centre there.
template <typename Visit>
void forTriangleRows(const std::array<Eigen::Vector2d, 3>& corner, const std::array<std::uint32_t, 3>& id,
                     int first_row, int last_row, const Visit& visit) {
  const double top = std::min({corner[0].y(), corner[1].y(), corner[2].y()});
  const double bottom = std::max({corner[0].y(), corner[1].y(), corner[2].y()});
  const auto centreAtOrAfter = [](double value) { return static_cast<int>(std::ceil(value - 0.5)); };
  const int begin = std::max(first_row, centreAtOrAfter(top));
  const int end = std::min(last_row, centreAtOrAfter(bottom));
  struct Side {
    double top, bottom, x, y, slope;
  };
  std::array<Side, 3> sides;
  for (std::size_t k = 0; k < 3; ++k) {
    std::size_t a = k, b = (k + 1) % 3;
    if (id[a] > id[b]) std::swap(a, b);  // the same numbers for both triangles of a side
    const Eigen::Vector2d edge = corner[b] - corner[a];
    sides[k] = {std::min(corner[a].y(), corner[b].y()), std::max(corner[a].y(), corner[b].y()), corner[a].x(),
                corner[a].y(), edge.y() != 0 ? edge.x() / edge.y() : 0};
  }
  for (int row = begin; row < end; ++row) {
    const double y = row + 0.5;
    double low = 0, high = 0;
    int crossings = 0;
    for (const Side& side : sides) {
      if (y < side.top || y >= side.bottom) continue;
      const double x = side.x + (y - side.y) * side.slope;
      low = crossings == 0 ? x : std::min(low, x);
      high = crossings == 0 ? x : std::max(high, x);
      ++crossings;
    }
    if (crossings == 2) visit(row, centreAtOrAfter(low), centreAtOrAfter(high));
  }
}

}  // namespace fathom::surface

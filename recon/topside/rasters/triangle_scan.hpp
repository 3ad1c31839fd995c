#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace fathom::topside {

// Calls visit(row, column, weights) for every cell whose middle lies in a triangle or on its border; `p` in
// cells (row, column), a cell's middle at its whole number; weights are the corners' shares.
template <typename Visit>
void scanTriangle(const std::array<Eigen::Vector2d, 3>& p, int rows, int columns, Visit&& visit) {
  constexpr double kOnBorder = -1e-9;  // a share so small is rounding
  const Eigen::Vector2d ab = p[1] - p[0], ac = p[2] - p[0];
  const double area2 = ab.x() * ac.y() - ab.y() * ac.x();
  if (!(std::abs(area2) > 1e-12)) return;  // seen edge on
  const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  const int x0 = std::max(0, static_cast<int>(std::ceil(low_x - 1e-6)));
  const int x1 = std::min(rows - 1, static_cast<int>(std::floor(high_x + 1e-6)));
  const int y0 = std::max(0, static_cast<int>(std::ceil(low_y - 1e-6)));
  const int y1 = std::min(columns - 1, static_cast<int>(std::floor(high_y + 1e-6)));
  // Shares are linear in row and column.
  const double w1_x = ac.y() / area2, w1_y = -ac.x() / area2;
  const double w2_x = -ab.y() / area2, w2_y = ab.x() / area2;
  for (int x = x0; x <= x1; ++x) {
    const double w1_row = (x - p[0].x()) * w1_x - p[0].y() * w1_y;
    const double w2_row = (x - p[0].x()) * w2_x - p[0].y() * w2_y;
    for (int y = y0; y <= y1; ++y) {
      const double w1 = w1_row + y * w1_y, w2 = w2_row + y * w2_y, w0 = 1 - w1 - w2;
      if (w0 < kOnBorder || w1 < kOnBorder || w2 < kOnBorder) continue;
      visit(x, y,
            std::array<float, 3>{static_cast<float>(w0), static_cast<float>(w1), static_cast<float>(w2)});
    }
  }
}

}  // namespace fathom::topside

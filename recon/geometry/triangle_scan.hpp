#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace fathom {

// Calls visit(row, column, shares) for every cell of a grid whose middle lies in a triangle or on its border;
// `p` in cells (row, column), a cell's middle at its whole number; the shares are the corners'.
template <typename Visit>
void scanTriangle(const std::array<Eigen::Vector2d, 3>& p, int rows, int columns, Visit&& visit) {
  constexpr double kOnBorder = -1e-9;  // a share so small is rounding
  const Eigen::Vector2d ab = p[1] - p[0], ac = p[2] - p[0];
  const double area2 = ab.x() * ac.y() - ab.y() * ac.x();
  if (!(std::abs(area2) > 1e-12)) return;  // seen edge on
  const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  // Bounded first: a corner may lie anywhere.
  const auto first = [](double low, int end) {
    return static_cast<int>(std::clamp(std::ceil(low - 1e-6), 0.0, static_cast<double>(end)));
  };
  const auto last = [](double high, int end) {
    return static_cast<int>(std::clamp(std::floor(high + 1e-6), -1.0, end - 1.0));
  };
  const int x0 = first(low_x, rows), x1 = last(high_x, rows);
  const int y0 = first(low_y, columns), y1 = last(high_y, columns);
  // Shares are linear in row and column.
  const double w1_x = ac.y() / area2, w1_y = -ac.x() / area2;
  const double w2_x = -ab.y() / area2, w2_y = ab.x() / area2;
  for (int x = x0; x <= x1; ++x) {
    const double w1_row = (x - p[0].x()) * w1_x - p[0].y() * w1_y;
    const double w2_row = (x - p[0].x()) * w2_x - p[0].y() * w2_y;
    for (int y = y0; y <= y1; ++y) {
      const double w1 = w1_row + y * w1_y, w2 = w2_row + y * w2_y, w0 = 1 - w1 - w2;
      if (w0 < kOnBorder || w1 < kOnBorder || w2 < kOnBorder) continue;
      visit(x, y, std::array<double, 3>{w0, w1, w2});
    }
  }
}

}  // namespace fathom

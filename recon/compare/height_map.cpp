#include "recon/compare/height_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/numbers/order_statistics.hpp"

namespace fathom::compare {

HeightMap::HeightMap(const Box& box, double cell_m) : cell(cell_m) {
  const double first = std::floor(box.west / cell), top = std::ceil(box.north / cell);
  west = first * cell;
  north = top * cell;
  columns = static_cast<int>(std::ceil(box.east / cell) - first);
  rows = static_cast<int>(top - std::floor(box.south / cell));
  up.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows),
            std::numeric_limits<float>::quiet_NaN());
}

std::size_t HeightMap::known() const {
  return static_cast<std::size_t>(
      std::count_if(up.begin(), up.end(), [](float h) { return std::isfinite(h); }));
}

double HeightMap::at(double east, double north_m) const {
  const double x = (east - west) / cell - 0.5, y = (north - north_m) / cell - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  if (!(x0 >= 0 && y0 >= 0 && x0 + 1 < columns && y0 + 1 < rows))
    return std::numeric_limits<double>::quiet_NaN();
  const std::size_t at = index(static_cast<int>(x0), static_cast<int>(y0));
  const auto value = [&](std::size_t i) { return static_cast<double>(up[i]); };
  const double fx = x - x0, fy = y - y0;
  const std::size_t below = at + static_cast<std::size_t>(columns);
  return (1 - fy) * ((1 - fx) * value(at) + fx * value(at + 1)) +
         fy * ((1 - fx) * value(below) + fx * value(below + 1));
}

HeightMap HeightMap::coarser(int factor) const {
  if (factor <= 1) return *this;
  HeightMap out;
  out.west = west;
  out.north = north;
  out.cell = cell * factor;
  out.columns = (columns + factor - 1) / factor;
  out.rows = (rows + factor - 1) / factor;
  const std::size_t size = static_cast<std::size_t>(out.columns) * static_cast<std::size_t>(out.rows);
  out.up.assign(size, std::numeric_limits<float>::quiet_NaN());
  if (!sigma.empty()) out.sigma.assign(size, std::numeric_limits<float>::quiet_NaN());
  for (int row = 0; row < out.rows; ++row) {
    for (int column = 0; column < out.columns; ++column) {
      double sum = 0, sigma_sum = 0;
      int count = 0;
      for (int y = row * factor; y < std::min(rows, (row + 1) * factor); ++y) {
        for (int x = column * factor; x < std::min(columns, (column + 1) * factor); ++x) {
          const std::size_t i = index(x, y);
          if (!std::isfinite(up[i])) continue;
          sum += static_cast<double>(up[i]);
          if (!sigma.empty()) sigma_sum += static_cast<double>(sigma[i]);
          ++count;
        }
      }
      if (2 * count < factor * factor) continue;
      out.up[out.index(column, row)] = static_cast<float>(sum / count);
      if (!sigma.empty()) out.sigma[out.index(column, row)] = static_cast<float>(sigma_sum / count);
    }
  }
  return out;
}

double medianHeight(const HeightMap& map) {
  std::vector<double> known;
  for (const float h : map.up)
    if (std::isfinite(h)) known.push_back(static_cast<double>(h));
  return median(std::move(known), std::numeric_limits<double>::quiet_NaN());
}

}  // namespace fathom::compare

#include "recon/surface/colour_grid.hpp"

#include <algorithm>
#include <cstddef>

namespace fathom::surface {
namespace {

std::size_t placeOf(const ColourGrid& grid, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) + static_cast<std::size_t>(x);
}

ColourGrid halved(const ColourGrid& fine) {
  ColourGrid out{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
  const std::size_t places = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.values.assign(4 * places, 0.0F);
  out.known.assign(places, 0);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const std::size_t to = placeOf(out, x, y);
      float count = 0;
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.height); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.width); ++u) {
          const std::size_t from = placeOf(fine, u, v);
          if (fine.known[from] == 0) continue;
          ++count;
          for (std::size_t c = 0; c < 4; ++c) out.values[4 * to + c] += fine.values[4 * from + c];
        }
      }
      if (count == 0) continue;
      out.known[to] = 1;
      for (std::size_t c = 0; c < 4; ++c) out.values[4 * to + c] /= count;
    }
  }
  return out;
}

// Between the four coarse places around the middle of a fine one.
void pushTo(ColourGrid& fine, const ColourGrid& coarse) {
  for (int y = 0; y < fine.height; ++y) {
    for (int x = 0; x < fine.width; ++x) {
      const std::size_t to = placeOf(fine, x, y);
      if (fine.known[to] != 0) continue;
      const int x0 = std::max(0, (x - 1) / 2), x1 = std::min((x + 1) / 2, coarse.width - 1);
      const int y0 = std::max(0, (y - 1) / 2), y1 = std::min((y + 1) / 2, coarse.height - 1);
      const float fx = x % 2 == 0 ? 0.75F : 0.25F, fy = y % 2 == 0 ? 0.75F : 0.25F;
      for (std::size_t c = 0; c < 4; ++c) {
        const auto value = [&](int u, int v) { return coarse.values[4 * placeOf(coarse, u, v) + c]; };
        const float top = value(x0, y0) + fx * (value(x1, y0) - value(x0, y0));
        const float bottom = value(x0, y1) + fx * (value(x1, y1) - value(x0, y1));
        fine.values[4 * to + c] = top + fy * (bottom - top);
      }
    }
  }
}

}  // namespace

bool fillSmoothly(ColourGrid& grid) {
  const auto unknown = std::count(grid.known.begin(), grid.known.end(), std::uint8_t{0});
  if (unknown == 0) return true;
  if (unknown == static_cast<std::ptrdiff_t>(grid.known.size())) return false;
  ColourGrid coarse = halved(grid);
  fillSmoothly(coarse);
  pushTo(grid, coarse);
  std::fill(grid.known.begin(), grid.known.end(), std::uint8_t{1});
  return true;
}

}  // namespace fathom::surface

#include "recon/surface/fill.hpp"

#include <algorithm>
#include <cassert>
#include <cstddef>

namespace fathom::surface {
namespace {

std::size_t pixelIndex(const ColourGrid& grid, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) + static_cast<std::size_t>(x);
}

ColourGrid halved(const ColourGrid& fine) {
  ColourGrid out{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
  const std::size_t places = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.values.assign(4 * places, 0.0F);
  out.known.assign(places, 0);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const std::size_t to = pixelIndex(out, x, y);
      float count = 0;
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.height); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.width); ++u) {
          const std::size_t from = pixelIndex(fine, u, v);
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
      const std::size_t to = pixelIndex(fine, x, y);
      if (fine.known[to] != 0) continue;
      const int x0 = std::max(0, (x - 1) / 2), x1 = std::min((x + 1) / 2, coarse.width - 1);
      const int y0 = std::max(0, (y - 1) / 2), y1 = std::min((y + 1) / 2, coarse.height - 1);
      const float fx = x % 2 == 0 ? 0.75F : 0.25F, fy = y % 2 == 0 ? 0.75F : 0.25F;
      for (std::size_t c = 0; c < 4; ++c) {
        const auto value = [&](int u, int v) { return coarse.values[4 * pixelIndex(coarse, u, v) + c]; };
        const float top = value(x0, y0) + fx * (value(x1, y0) - value(x0, y0));
        const float bottom = value(x0, y1) + fx * (value(x1, y1) - value(x0, y1));
        fine.values[4 * to + c] = top + fy * (bottom - top);
      }
    }
  }
}

}  // namespace

void fillUnknown(RgbImage& image, const std::vector<std::uint8_t>& known) {
  const auto width = static_cast<std::size_t>(image.width), height = static_cast<std::size_t>(image.height);
  assert(known.size() == width * height);
  if (std::find(known.begin(), known.end(), 0) == known.end() ||
      std::find(known.begin(), known.end(), 1) == known.end())
    return;
  // Half the size: the mean of the known among four.
  const std::size_t half_width = (width + 1) / 2, half_height = (height + 1) / 2;
  RgbImage half{static_cast<int>(half_width), static_cast<int>(half_height), {}};
  half.rgb.assign(3 * half_width * half_height, 0);
  std::vector<std::uint8_t> half_known(half_width * half_height, 0);
  for (std::size_t y = 0; y < half_height; ++y)
    for (std::size_t x = 0; x < half_width; ++x) {
      unsigned count = 0, sum[3] = {0, 0, 0};
      for (std::size_t v = 2 * y; v < std::min(height, 2 * y + 2); ++v)
        for (std::size_t u = 2 * x; u < std::min(width, 2 * x + 2); ++u) {
          if (known[v * width + u] == 0) continue;
          ++count;
          for (std::size_t c = 0; c < 3; ++c) sum[c] += image.rgb[3 * (v * width + u) + c];
        }
      if (count == 0) continue;
      half_known[y * half_width + x] = 1;
      for (std::size_t c = 0; c < 3; ++c)
        half.rgb[3 * (y * half_width + x) + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    }
  fillUnknown(half, half_known);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      if (known[y * width + x] == 0)
        for (std::size_t c = 0; c < 3; ++c)
          image.rgb[3 * (y * width + x) + c] = half.rgb[3 * (y / 2 * half_width + x / 2) + c];
}

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

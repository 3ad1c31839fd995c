#include "recon/surface/fill.hpp"

#include <algorithm>
#include <cassert>
#include <cstddef>

namespace fathom::surface {

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

}  // namespace fathom::surface

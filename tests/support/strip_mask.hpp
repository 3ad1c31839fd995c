#pragma once

#include "recon/geometry/image_view.hpp"

namespace fathom::test {

// Hides the columns from `first` to `last`.
inline ImageMask stripMask(int width, int height, int first, int last) {
  ImageMask mask{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      mask.clearance.push_back(static_cast<std::uint8_t>(std::min(255, std::max({0, first - x, x - last}))));
  return mask;
}

}  // namespace fathom::test

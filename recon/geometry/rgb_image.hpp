#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace fathom {

// An 8-bit sRGB image, top row first, rows without padding.
struct RgbImage {
  int width = 0, height = 0;      // [px]
  std::vector<std::uint8_t> rgb;  // 3 * width * height

  [[nodiscard]] bool empty() const { return width <= 0 || height <= 0; }
  [[nodiscard]] std::uint8_t* at(int x, int y) {
    return &rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(x))];
  }
  [[nodiscard]] const std::uint8_t* at(int x, int y) const {
    return &rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(x))];
  }
};

}  // namespace fathom

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace fathom {

// Which pixels of a camera's image show parts of the vehicle, and how far every other one is from these.
struct ImageMask {
  static constexpr float kFarthest = 255;  // [px]; no more is counted

  int width = 0, height = 0;            // of the image [px]
  std::vector<std::uint8_t> clearance;  // row by row: distance from the nearest hidden pixel [px]; 0: hidden

  // At an image position; of positions outside that of the nearest pixel.
  [[nodiscard]] float clearanceAt(float u, float v) const {
    const int x = std::clamp(static_cast<int>(std::lround(u)), 0, width - 1);
    const int y = std::clamp(static_cast<int>(std::lround(v)), 0, height - 1);
    return clearance[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(x)];
  }
  // Whether a window about the pixel that reaches `margin` [px] to every side meets what is hidden.
  [[nodiscard]] bool hides(const Eigen::Vector2d& pixel, double margin = 0) const {
    return static_cast<double>(clearanceAt(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()))) <=
           margin;
  }
};

}  // namespace fathom

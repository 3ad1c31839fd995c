#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "recon/geometry/camera.hpp"

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

enum class PixelFormat : std::uint8_t { kMono, kBayerRggb, kRgb };

[[nodiscard]] inline std::size_t samplesPerPixel(PixelFormat format) {
  return format == PixelFormat::kRgb ? 3 : 1;
}

// Pixels in memory of another owner, top row first. Samples are uint8_t when bits == 8, else uint16_t holding
// `bits` significant low bits.
struct ImageView {
  const void* data = nullptr;
  int width = 0;           // [px]
  int height = 0;          // [px]
  std::size_t stride = 0;  // [bytes] from row to row
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;                     // 8 to 16
  const ImageMask* mask = nullptr;  // of what it shows of the vehicle; null: nothing

  [[nodiscard]] bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
};

[[nodiscard]] inline std::size_t pixelsOf(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

// A camera's image of 8-bit samples, rows without padding; `samples` holds pixelsOf() times
// samplesPerPixel().
[[nodiscard]] inline ImageView eightBitView(const std::vector<std::uint8_t>& samples, const Camera& camera,
                                            PixelFormat format, const ImageMask* mask = nullptr) {
  return {samples.data(),
          camera.width,
          camera.height,
          static_cast<std::size_t>(camera.width) * samplesPerPixel(format),
          format,
          8,
          mask};
}

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

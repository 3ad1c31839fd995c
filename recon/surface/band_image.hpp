#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::surface {

// Widths of the low passes between the bands of an image: means of squares of so many pixels, smoothed
// by (1 4 6 4 1)/16, which are about Gaussian. Whole numbers, at least 2.
struct BandWidths {
  int fine = 4;       // s1, between the high and the middle band [px]
  int coarse = 4;     // s2 = coarse * s1, between the middle and the low band
  int reduction = 1;  // the image is first reduced by this factor, where texels are larger than its pixels
  // Amplifies fine detail by as much as interpolation between pixels attenuates it, so that a texture keeps
  // the image's spectrum: (-5 74 -5)/64 along each axis. At places spread evenly between pixels interpolation
  // leaves 1 - (1 - cos w)/3 of the power at w, which this multiplies by (1 + (1 - cos w)/6.4)^2: together
  // 0.97 to 1 up to a sixth of the sampling frequency, 0.89 (instead of 0.67) at a quarter.
  bool restore = true;
};

// A low pass: the mean of squares of `scale` pixels, smoothed. Four values a pixel (the fourth 0), each kUnit
// times the grey level.
struct LowPass {
  static constexpr int kUnit = 64;
  int width = 0, height = 0, scale = 0;
  std::vector<std::uint16_t> values;  // 4 * width * height
};

// An image (reduced if configured) and its low passes.
struct BandImage {
  RgbImage image;
  LowPass fine, coarse;                   // G(s1), G(s2)
  std::shared_ptr<const ImageMask> mask;  // of the image before it was reduced; null: nothing is hidden
  int reduction = 1;

  // Weight of the image at a position: 0 where it is hidden, rising to 1 at `fade` [px] from there.
  [[nodiscard]] float openness(float u, float v, float fade) const {
    if (!mask) return 1;
    const auto by = static_cast<float>(reduction);
    const float clear = mask->clearanceAt(by * (u + 0.5F) - 0.5F, by * (v + 0.5F) - 0.5F);
    return std::min(clear / std::min(by * fade, ImageMask::kFarthest), 1.0F);
  }

  [[nodiscard]] std::size_t bytes() const {
    return image.rgb.size() + 2 * (fine.values.size() + coarse.values.size());
  }
};

// `image` must be at least as large as one coarse square (scale * scale px). Fill the parts that `mask` hides
// before: they enter the means of their surroundings.
[[nodiscard]] BandImage makeBands(RgbImage image, const BandWidths& widths,
                                  std::shared_ptr<const ImageMask> mask = nullptr);

}  // namespace fathom::surface

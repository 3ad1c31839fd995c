#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/rgb_image.hpp"

namespace fathom::surface {

// How a texture changes from texel to texel where the images behind it change, against where they do not.
struct SeamMeasure {
  double across = 0, inside = 0;  // mean absolute step between neighbouring texels [grey levels]
  std::uint64_t pairs_across = 0, pairs_inside = 0;
  // 1: borders of images cannot be seen.
  [[nodiscard]] double ratio() const { return inside > 0 ? across / inside : 0; }
  SeamMeasure& operator+=(const SeamMeasure& other);
};

// `region`: a number a texel; where it differs between neighbours, an image's border runs. kNoRegion: a texel
// that does not count.
constexpr std::uint64_t kNoRegion = 0;
[[nodiscard]] SeamMeasure measureSeams(const RgbImage& texture, const std::vector<std::uint64_t>& region);

// The detail that a texture shows: squared Sobel gradients, which look past the noise of single pixels, mean
// over the colours, summed over the texels that `counts` admits with their eight neighbours.
struct GradientEnergy {
  double sum = 0;  // [(grey levels a texel)^2]
  std::uint64_t texels = 0;
  [[nodiscard]] double mean() const { return texels > 0 ? sum / static_cast<double>(texels) : 0; }
};
[[nodiscard]] GradientEnergy gradientEnergy(const RgbImage& texture, const std::vector<std::uint8_t>& counts);

}  // namespace fathom::surface

#include "recon/lighting/texture_gain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace fathom::lighting {
namespace {

constexpr int kTextureCell = 4, kTextureCells = 8;  // [px], a side; noise of single pixels is no texture
constexpr int kTextureBlock = kTextureCell * kTextureCells;

// Of the cells' means in a block: standard deviation.
float spreadOf(const std::uint8_t* block, std::size_t width) {
  float sum = 0, squares = 0;
  for (std::size_t row = 0; row < kTextureCells; ++row)
    for (std::size_t column = 0; column < kTextureCells; ++column) {
      const std::uint8_t* at = block + kTextureCell * (row * width + column);
      int levels = 0;
      for (int y = 0; y < kTextureCell; ++y, at += width)
        for (int x = 0; x < kTextureCell; ++x) levels += at[x];
      const float mean = static_cast<float>(levels) / (kTextureCell * kTextureCell);
      sum += mean, squares += mean * mean;
    }
  constexpr float kAll = kTextureCells * kTextureCells;
  return std::sqrt(std::max(squares / kAll - sum * sum / (kAll * kAll), 0.0F));
}

}  // namespace

float textureGain(const std::uint8_t* grey, int width, int height) {
  constexpr int kLeast = 4, kPerLevel = 16;  // least spread that is enough [levels]; its classes
  constexpr float kMost = 16;
  std::array<int, kLeast* kPerLevel + 1> of_class = {};  // blocks; the last: enough
  int blocks = 0;
  for (int y = 0; y + kTextureBlock <= height; y += 2 * kTextureBlock)
    for (int x = 0; x + kTextureBlock <= width; x += 2 * kTextureBlock, ++blocks) {
      const auto stride = static_cast<std::size_t>(width);
      const float spread = spreadOf(grey + static_cast<std::size_t>(y) * stride + x, stride);
      ++of_class[static_cast<std::size_t>(kPerLevel * std::min(spread, float{kLeast}))];
    }
  if (blocks == 0) return 1;
  std::size_t median = 0;
  for (int below = of_class[0]; 2 * below < blocks; below += of_class[median]) ++median;
  return std::clamp(float{kLeast * kPerLevel} / (static_cast<float>(median) + 0.5F), 1.0F, kMost);
}

}  // namespace fathom::lighting

#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>

#include "recon/products/tiles/block_texture.hpp"

namespace fathom::topside {

constexpr std::size_t kBlockBytes = 8;
constexpr int kMaxTextureEdge = 16384;

[[nodiscard]] inline std::size_t levelBytes(int width, int height) {
  return kBlockBytes * static_cast<std::size_t>((width + 3) / 4) * static_cast<std::size_t>((height + 3) / 4);
}
[[nodiscard]] inline std::pair<int, int> levelSize(const BlockTexture& texture, std::size_t level) {
  return {std::max(1, texture.width >> level), std::max(1, texture.height >> level)};
}
// Levels down to one texel.
[[nodiscard]] inline std::size_t fullChain(int width, int height) {
  std::size_t levels = 1;
  for (int edge = std::max(width, height); edge > 1; edge /= 2) ++levels;
  return levels;
}

}  // namespace fathom::topside

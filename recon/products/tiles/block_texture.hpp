#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::topside {

// A texture as a GPU keeps it: BC1 (DXT1, S3TC), half a byte a texel, sRGB, with all mip levels down to one
// texel. A level is ceil(width / 4) x ceil(height / 4) blocks of 8 bytes, top row first; level k is
// max(1, width >> k) x max(1, height >> k) texels.
struct BlockTexture {
  int width = 0, height = 0;
  std::vector<std::vector<std::uint8_t>> levels;
  bool operator==(const BlockTexture&) const = default;
};

// Range fit on the principal axis, then the ends by least squares (as van Waveren 2006 and Brown's libsquish
// have it), sixteen pixels at once. A level's texels are means of four of the level above. Throws
// std::invalid_argument for an empty image. The same image gives the same bytes on every processor.
[[nodiscard]] BlockTexture compressBlocks(const RgbImage& image);

// What a GPU makes of a level.
[[nodiscard]] RgbImage decompressBlocks(const BlockTexture& texture, std::size_t level);

// DirectDraw Surface with the legacy DXT1 code, which every reader knows.
[[nodiscard]] std::vector<std::uint8_t> writeDds(const BlockTexture& texture);
[[nodiscard]] BlockTexture readDds(std::span<const std::uint8_t> bytes, const std::string& name);

enum class Supercompression : std::uint8_t { kNone, kZstd };
// KTX 2.0 (Khronos), VK_FORMAT_BC1_RGB_SRGB_BLOCK: goes to the GPU as it is, without transcoding. With
// kZstd each level is compressed by itself.
[[nodiscard]] std::vector<std::uint8_t> writeKtx2(
    const BlockTexture& texture, Supercompression supercompression = Supercompression::kNone);
[[nodiscard]] BlockTexture readKtx2(std::span<const std::uint8_t> bytes, const std::string& name);

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

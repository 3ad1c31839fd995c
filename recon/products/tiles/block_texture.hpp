#pragma once

#include <cstdint>
#include <span>
#include <string>
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

}  // namespace fathom::topside

#include "recon/products/tiles/block_texture.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "recon/products/tiles/bc1/block_rows.hpp"
#include "recon/products/tiles/block_layout.hpp"

namespace fathom::topside {
namespace {

std::vector<std::uint8_t> compressLevel(const RgbImage& image) {
  static const CompressBlockRow compress = fastestBlockRow();
  const int across = (image.width + 3) / 4, down = (image.height + 3) / 4;
  std::vector<std::uint8_t> out(levelBytes(image.width, image.height));
  std::vector<std::uint8_t> padded(image.width % 4 == 0 ? 0 : 4 * 12 * static_cast<std::size_t>(across));
  for (int row = 0; row < down; ++row) {
    std::array<const std::uint8_t*, 4> rows{};
    for (int k = 0; k < 4; ++k) {
      const int y = std::min(4 * row + k, image.height - 1);
      rows[static_cast<std::size_t>(k)] = image.at(0, y);
      if (padded.empty()) continue;
      std::uint8_t* copy = padded.data() + static_cast<std::ptrdiff_t>(k) * 12 * across;
      for (int x = 0; x < 4 * across; ++x)
        std::copy_n(image.at(std::min(x, image.width - 1), y), 3, copy + 3 * x);
      rows[static_cast<std::size_t>(k)] = copy;
    }
    compress(rows.data(), across, out.data() + static_cast<std::ptrdiff_t>(row) * 8 * across);
  }
  return out;
}

RgbImage halve(const RgbImage& image) {
  RgbImage half{std::max(1, image.width / 2), std::max(1, image.height / 2), {}};
  half.rgb.resize(3 * static_cast<std::size_t>(half.width) * static_cast<std::size_t>(half.height));
  for (int y = 0; y < half.height; ++y) {
    const std::uint8_t* above = image.at(0, std::min(2 * y, image.height - 1));
    const std::uint8_t* below = image.at(0, std::min(2 * y + 1, image.height - 1));
    std::uint8_t* out = half.at(0, y);
    const int right = image.width > 1 ? 3 : 0;
    for (int x = 0; x < half.width; ++x)
      for (int c = 0; c < 3; ++c) {
        const int at = 6 * x + c;
        out[3 * x + c] = static_cast<std::uint8_t>(
            (above[at] + above[at + right] + below[at] + below[at + right] + 2) / 4);
      }
  }
  return half;
}

}  // namespace

BlockTexture compressBlocks(const RgbImage& image) {
  if (image.empty()) throw std::invalid_argument("a texture without texels");
  BlockTexture texture{image.width, image.height, {}};
  texture.levels.push_back(compressLevel(image));
  RgbImage level;
  for (const RgbImage* above = &image; above->width > 1 || above->height > 1; above = &level) {
    level = halve(*above);
    texture.levels.push_back(compressLevel(level));
  }
  return texture;
}

RgbImage decompressBlocks(const BlockTexture& texture, std::size_t level) {
  const auto [width, height] = levelSize(texture, level);
  const int across = (width + 3) / 4;
  RgbImage image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* block = texture.levels.at(level).data() + 8 * ((y / 4) * across + x / 4);
      const std::array<int, 2> word{block[0] | block[1] << 8, block[2] | block[3] << 8};
      const int index = block[4 + y % 4] >> (2 * (x % 4)) & 3;
      for (int c = 0; c < 3; ++c) {
        const auto end = [&](std::size_t e) {
          const int value = c == 0 ? word[e] >> 11 : c == 1 ? word[e] >> 5 & 63 : word[e] & 31;
          return c == 1 ? value << 2 | value >> 4 : value << 3 | value >> 2;
        };
        const int a = end(0), b = end(1);
        const bool four = word[0] > word[1];
        const int colour = index == 0   ? a
                           : index == 1 ? b
                           : index == 2 ? (four ? (2 * a + b) / 3 : (a + b) / 2)
                                        : (four ? (a + 2 * b) / 3 : 0);
        image.at(x, y)[c] = static_cast<std::uint8_t>(colour);
      }
    }
  return image;
}

}  // namespace fathom::topside

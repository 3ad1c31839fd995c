#include "recon/products/tiles/block_texture.hpp"

#include <zstd.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <stdexcept>

#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/bc1/block_rows.hpp"

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

namespace {

static_assert(std::endian::native == std::endian::little, "headers are written in native byte order");

// DDS: Microsoft's programming guide for DDS, DDS_HEADER.
constexpr std::uint32_t kDdsMagic = 0x20534444, kDdsHeaderBytes = 124, kPixelFormatBytes = 32;
constexpr std::uint32_t kDxt1 = 0x31545844, kFourCc = 0x4;
constexpr std::uint32_t kDdsFlags =
    0x1 | 0x2 | 0x4 | 0x1000 | 0x20000 | 0x80000;            // sizes, format, mips, linear
constexpr std::uint32_t kDdsCaps = 0x8 | 0x1000 | 0x400000;  // complex, texture, mipmap
constexpr std::size_t kDdsBytes = 4 + kDdsHeaderBytes;
// 32-bit words of the file.
enum DdsWord : std::size_t {
  kDdsHeight = 3,
  kDdsWidth = 4,
  kDdsLinear = 5,
  kDdsLevels = 7,
  kDdsFormat = 19,
  kDdsCode = 21,
  kDdsCapsAt = 27
};

// KTX: KTX File Format Specification 2.0, sections 3 and 5; Khronos Data Format Specification 1.3, section 5.
constexpr std::array<std::uint8_t, 12> kKtxMagic{0xAB, 'K',  'T',  'X',  ' ',  '2',
                                                 '0',  0xBB, '\r', '\n', 0x1A, '\n'};
constexpr std::uint32_t kBc1RgbSrgb = 132, kZstdScheme = 2;
constexpr std::size_t kKtxIndexAt = 48, kLevelIndexAt = 80, kLevelIndexBytes = 24;
constexpr std::size_t kLevelAlignment = 8;  // least common multiple of a block's bytes and 4
// Basic descriptor: one sample of 64 bits, model BC1A (128), primaries BT.709 (1), transfer sRGB (2), blocks
// of 4 x 4 (written as 3 and 3), 8 bytes in plane 0; the descriptor's version is 2, its size 24 + 16.
constexpr std::array<std::uint32_t, 11> kDescriptor{
    44, 0, 2 | 40U << 16, 128 | 1U << 8 | 2U << 16, 3 | 3U << 8, 8, 0, 63U << 16, 0, 0, 0xFFFFFFFF};
constexpr int kZstdLevel = 3;  // 9 saves a twentieth at four times the time

template <typename Number>
void put(std::vector<std::uint8_t>& out, Number value) {
  std::uint8_t bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.insert(out.end(), bytes, bytes + sizeof value);
}
template <typename Number>
void putAt(std::vector<std::uint8_t>& out, std::size_t at, Number value) {
  std::memcpy(out.data() + at, &value, sizeof value);
}
template <typename Number>
Number get(std::span<const std::uint8_t> bytes, std::size_t at) {
  Number value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void checkWhole(const BlockTexture& texture) {
  if (texture.width <= 0 || texture.height <= 0 ||
      texture.levels.size() != fullChain(texture.width, texture.height))
    throw std::invalid_argument("a texture without all its mip levels");
  for (std::size_t k = 0; k < texture.levels.size(); ++k) {
    const auto [width, height] = levelSize(texture, k);
    if (texture.levels[k].size() != levelBytes(width, height))
      throw std::invalid_argument("a mip level of another size");
  }
}

// Sizes as a header names them; throws where no texture of a tile has them.
BlockTexture sized(std::uint32_t width, std::uint32_t height, std::uint32_t levels, const std::string& name) {
  if (width == 0 || height == 0 || width > kMaxTextureEdge || height > kMaxTextureEdge)
    throw InputError(name, "header", "names a size that no tile has");
  BlockTexture texture{static_cast<int>(width), static_cast<int>(height), {}};
  if (levels != fullChain(texture.width, texture.height))
    throw InputError(name, "header", "does not name all mip levels");
  texture.levels.resize(levels);
  return texture;
}

// Key and value of KTX's metadata, padded to 4 bytes.
void putPair(std::vector<std::uint8_t>& out, const std::string& key, const std::string& value) {
  put(out, static_cast<std::uint32_t>(key.size() + value.size() + 2));
  for (const std::string& text : {key, value}) {
    out.insert(out.end(), text.begin(), text.end());
    out.push_back(0);
  }
  while (out.size() % 4 != 0) out.push_back(0);
}

std::vector<std::uint8_t> zstd(const std::vector<std::uint8_t>& data) {
  std::vector<std::uint8_t> out(ZSTD_compressBound(data.size()));
  const std::size_t size = ZSTD_compress(out.data(), out.size(), data.data(), data.size(), kZstdLevel);
  if (ZSTD_isError(size) != 0U) throw std::runtime_error(std::string("zstd: ") + ZSTD_getErrorName(size));
  out.resize(size);
  return out;
}

}  // namespace

std::vector<std::uint8_t> writeDds(const BlockTexture& texture) {
  checkWhole(texture);
  std::array<std::uint32_t, kDdsBytes / 4> words{};
  words[0] = kDdsMagic;
  words[1] = kDdsHeaderBytes;
  words[2] = kDdsFlags;
  words[kDdsHeight] = static_cast<std::uint32_t>(texture.height);
  words[kDdsWidth] = static_cast<std::uint32_t>(texture.width);
  words[kDdsLinear] = static_cast<std::uint32_t>(texture.levels[0].size());
  words[kDdsLevels] = static_cast<std::uint32_t>(texture.levels.size());
  words[kDdsFormat] = kPixelFormatBytes;
  words[kDdsFormat + 1] = kFourCc;
  words[kDdsCode] = kDxt1;
  words[kDdsCapsAt] = kDdsCaps;
  std::vector<std::uint8_t> out;
  for (const std::uint32_t word : words) put(out, word);
  for (const auto& level : texture.levels) out.insert(out.end(), level.begin(), level.end());
  return out;
}

BlockTexture readDds(std::span<const std::uint8_t> bytes, const std::string& name) {
  const auto word = [&](std::size_t k) { return get<std::uint32_t>(bytes, 4 * k); };
  if (bytes.size() < kDdsBytes || word(0) != kDdsMagic || word(1) != kDdsHeaderBytes ||
      word(kDdsCode) != kDxt1)
    throw InputError(name, "header", "is not that of a DDS file with DXT1");
  BlockTexture texture = sized(word(kDdsWidth), word(kDdsHeight), word(kDdsLevels), name);
  std::size_t at = kDdsBytes;
  for (std::size_t k = 0; k < texture.levels.size(); ++k) {
    const auto [width, height] = levelSize(texture, k);
    const std::size_t size = levelBytes(width, height);
    if (bytes.size() - at < size) throw InputError(name, "mip level " + std::to_string(k), "is cut off");
    texture.levels[k].assign(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                             bytes.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  return texture;
}

std::vector<std::uint8_t> writeKtx2(const BlockTexture& texture, Supercompression supercompression) {
  checkWhole(texture);
  const bool packed = supercompression == Supercompression::kZstd;
  const std::size_t count = texture.levels.size();
  std::vector<std::uint8_t> out(kKtxMagic.begin(), kKtxMagic.end());
  for (const std::uint32_t word : {kBc1RgbSrgb, 1U, static_cast<std::uint32_t>(texture.width),
                                   static_cast<std::uint32_t>(texture.height), 0U, 0U, 1U,
                                   static_cast<std::uint32_t>(count), packed ? kZstdScheme : 0U})
    put(out, word);
  out.resize(kLevelIndexAt + kLevelIndexBytes * count);
  const std::size_t descriptor_at = out.size();
  for (const std::uint32_t word : kDescriptor) put(out, word);
  const std::size_t pairs_at = out.size();
  putPair(out, "KTXorientation", "rd");
  putPair(out, "KTXwriter", "Fathom");
  putAt(out, kKtxIndexAt, static_cast<std::uint32_t>(descriptor_at));
  putAt(out, kKtxIndexAt + 4, static_cast<std::uint32_t>(pairs_at - descriptor_at));
  putAt(out, kKtxIndexAt + 8, static_cast<std::uint32_t>(pairs_at));
  putAt(out, kKtxIndexAt + 12, static_cast<std::uint32_t>(out.size() - pairs_at));
  for (std::size_t k = count; k-- > 0;) {  // the smallest first, so that a stream shows something early
    while (!packed && out.size() % kLevelAlignment != 0) out.push_back(0);
    const std::vector<std::uint8_t> data = packed ? zstd(texture.levels[k]) : texture.levels[k];
    const std::size_t index = kLevelIndexAt + kLevelIndexBytes * k;
    putAt(out, index, static_cast<std::uint64_t>(out.size()));
    putAt(out, index + 8, static_cast<std::uint64_t>(data.size()));
    putAt(out, index + 16, static_cast<std::uint64_t>(texture.levels[k].size()));
    out.insert(out.end(), data.begin(), data.end());
  }
  return out;
}

BlockTexture readKtx2(std::span<const std::uint8_t> bytes, const std::string& name) {
  const auto word = [&](std::size_t k) { return get<std::uint32_t>(bytes, kKtxMagic.size() + 4 * k); };
  if (bytes.size() < kLevelIndexAt || !std::equal(kKtxMagic.begin(), kKtxMagic.end(), bytes.begin()))
    throw InputError(name, "header", "is not that of a KTX 2.0 file");
  if (word(0) != kBc1RgbSrgb || word(6) != 1 || (word(8) != 0 && word(8) != kZstdScheme))
    throw InputError(name, "header", "is of another format than one BC1 picture");
  const bool packed = word(8) == kZstdScheme;
  BlockTexture texture = sized(word(2), word(3), word(7), name);
  if (bytes.size() < kLevelIndexAt + kLevelIndexBytes * texture.levels.size())
    throw InputError(name, "level index", "is cut off");
  for (std::size_t k = 0; k < texture.levels.size(); ++k) {
    const std::string place = "mip level " + std::to_string(k);
    const std::size_t index = kLevelIndexAt + kLevelIndexBytes * k;
    const auto at = get<std::uint64_t>(bytes, index), size = get<std::uint64_t>(bytes, index + 8);
    const auto [width, height] = levelSize(texture, k);
    const std::size_t whole = levelBytes(width, height);
    if (at > bytes.size() || size > bytes.size() - at) throw InputError(name, place, "is cut off");
    if (get<std::uint64_t>(bytes, index + 16) != whole || (!packed && size != whole))
      throw InputError(name, place, "has another size than its texels");
    const std::span<const std::uint8_t> data = bytes.subspan(at, size);
    if (!packed) {
      texture.levels[k].assign(data.begin(), data.end());
      continue;
    }
    texture.levels[k].resize(whole);
    if (ZSTD_decompress(texture.levels[k].data(), whole, data.data(), data.size()) != whole)
      throw InputError(name, place, "is damaged");
  }
  return texture;
}

}  // namespace fathom::topside

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"

namespace fathom::io {

// Pixels of a TIFF, rows without padding, top row first; 16 bit samples in the machine's byte order.
struct TiffPixels {
  int width = 0;     // [px]
  int height = 0;    // [px]
  int channels = 0;  // 1 (black is zero) or 3 (RGB)
  int bits = 0;      // of a sample: 8 or 16
  std::vector<std::uint8_t> bytes;
};

// libtiff over memory, without its habit of printing: what it would print ends in `error`.
// Returns false for bytes that are not a whole TIFF of unsigned 8 or 16 bit samples, one or three channels,
// in strips, of at most kMaxTiffPixels.
constexpr std::size_t kMaxTiffPixels = std::size_t{1} << 27;
[[nodiscard]] bool decodeTiff(std::span<const std::uint8_t> file, TiffPixels& pixels, std::string& error);

// Lossless deflate. `rows`: first byte of the top row; `stride` [bytes]. Throws std::runtime_error if libtiff
// fails.
[[nodiscard]] std::vector<std::uint8_t> encodeTiff(const void* rows, std::size_t stride, int width,
                                                   int height, int channels, int bits);

inline constexpr std::size_t kMaxImageFileBytes = std::size_t{1} << 28;

// Grey or RGB of 8 or 16 bit by libpng, silent. False for bytes that are no such whole PNG, or one of more
// than kMaxTiffPixels.
[[nodiscard]] bool decodePng(std::span<const std::uint8_t> file, TiffPixels& pixels, std::string& error);

// By what the bytes say they are; neither: the TIFF decoder's error.
[[nodiscard]] bool decodeTiffOrPng(std::span<const std::uint8_t> file, TiffPixels& pixels,
                                   std::string& error);

// Of 16-bit samples.
[[nodiscard]] std::uint16_t largestSample(const TiffPixels& pixels);
// 8, or the fewest of 10, 12 and 16 that hold the brightest sample.
[[nodiscard]] int usedBits(const TiffPixels& pixels);

// Pixels with a format that fits their channels; `bits` of their samples are used.
[[nodiscard]] ImageFile imageFileOf(TiffPixels&& pixels, PixelFormat format, int bits);

}  // namespace fathom::io

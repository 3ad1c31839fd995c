#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/images/tiff_codec.hpp"

namespace fathom::io {

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

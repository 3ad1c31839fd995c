#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// The head of an uncompressed TIFF whose pixels follow as they lie in memory, so that an image goes to the
// disk straight from the camera's block: no copy, no heap, and its size is known before it is written.
// (Deflate of sensor noise saves a quarter of the bytes and takes 80 ms for 1360 x 1024 of 12 bits: a third
// of a core for two cameras at 2 Hz.) TIFF 6.0, strips of whole rows, the machine's little endian.
constexpr std::size_t kTiffHeadBytes = 4096;  // a page, so that the pixels begin on one
using TiffHead = std::array<std::uint8_t, kTiffHeadBytes>;

// `image` is not empty, 8 or 16 bit samples, one channel or RGB.
[[nodiscard]] TiffHead tiffHead(const ImageView& image);
[[nodiscard]] std::size_t rowBytes(const ImageView& image);
[[nodiscard]] std::size_t tiffBytes(const ImageView& image);  // of the whole file

}  // namespace fathom::io

#pragma once

#include <cstddef>
#include <cstdint>

namespace fathom {

struct ImageMask;

enum class PixelFormat : std::uint8_t { kMono, kBayerRggb, kRgb };

// Pixels that somebody else owns, top row first. Samples are uint8_t when bits == 8, else uint16_t holding
// `bits` significant low bits.
struct ImageView {
  const void* data = nullptr;
  int width = 0;           // [px]
  int height = 0;          // [px]
  std::size_t stride = 0;  // [bytes] from row to row
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;                     // 8 to 16
  const ImageMask* mask = nullptr;  // of what it shows of the vehicle; null: nothing

  [[nodiscard]] bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
};

}  // namespace fathom

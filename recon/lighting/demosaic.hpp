#pragma once

#include <array>
#include <cstdint>

#include "recon/geometry/image_view.hpp"

namespace fathom::lighting {

// Bilinear demosaic of an 8-bit RGGB mosaic (as correct() gives) to RGB; `out` is width * height * 3 bytes. A
// mono image is copied three times, an RGB image once. An image that is empty or not of 8 bits leaves `out`
// as it is.
void demosaicRgb(const ImageView& mosaic, std::uint8_t* out);

// Shares of red, green and blue in grey, of kWhole in all.
using GreyShares = std::array<std::uint16_t, 3>;
inline constexpr int kShareBits = 8;
inline constexpr unsigned kWhole = 1U << kShareBits;
// Of an image as it comes: of a mosaic alike, as a sensor without colour filters sees the sum; of RGB, which
// often holds hues at half the resolution, its luminance (ITU-R BT.601).
[[nodiscard]] constexpr GreyShares usualShares(PixelFormat format) {
  return format == PixelFormat::kRgb ? GreyShares{77, 150, 29} : GreyShares{85, 86, 85};
}

// demosaicRgb() into `rgb`, then grey of these shares into `grey` (width * height bytes). A mono image is
// copied, without need of `rgb`.
void greyOf(const ImageView& mosaic, const GreyShares& shares, std::uint8_t* rgb, std::uint8_t* grey);

// Makes pixels of `rgb` grey where a sample of `raw` (the camera's image of the same size) reaches `limit` of
// full scale in any channel.
void neutraliseClipped(const ImageView& raw, double limit, std::uint8_t* rgb);

}  // namespace fathom::lighting

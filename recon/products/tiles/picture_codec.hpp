#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::topside {

enum class PictureFormat : std::uint8_t { kNone, kJpeg, kWebp };

struct PictureConfig {
  PictureFormat format = PictureFormat::kJpeg;
  int quality = 80;  // 1 to 100, on the format's own scale
  // JPEG: colour at half the resolution (4:2:0), faster; at the same size it is worse. WebP always does so.
  bool half_chroma = false;
  int webp_effort = 1;  // 0 fastest to 6 smallest
};

// A whole JPEG (libjpeg-turbo) or WebP (libwebp) file. Throws std::invalid_argument for an empty image or
// kNone, std::runtime_error where the library refuses (WebP: an edge over 16383).
[[nodiscard]] std::vector<std::uint8_t> encodePicture(const RgbImage& image, const PictureConfig& config);

// Reads a JPEG or WebP file, known by its first bytes. Throws InputError naming `name` for anything else, for
// damage, and for a picture with an edge over `max_edge`.
[[nodiscard]] RgbImage decodePicture(std::span<const std::uint8_t> bytes, const std::string& name,
                                     int max_edge = 16384);
[[nodiscard]] PictureFormat formatOf(std::span<const std::uint8_t> bytes);

// Peak signal-to-noise ratio over all samples [dB]; infinite for equal images. The sizes must be equal.
[[nodiscard]] double psnr(const RgbImage& image, const RgbImage& reference);

}  // namespace fathom::topside

#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom {

inline std::size_t samplesPerPixel(PixelFormat format) {
  return format == PixelFormat::kRgb ? 3 : 1;
}

inline std::size_t pixelsOf(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

// A camera's image of 8-bit samples, rows without padding; `samples` holds pixelsOf() times
// samplesPerPixel().
inline ImageView eightBitView(const std::vector<std::uint8_t>& samples, const Camera& camera,
                              PixelFormat format, const ImageMask* mask = nullptr) {
  return {samples.data(),
          camera.width,
          camera.height,
          static_cast<std::size_t>(camera.width) * samplesPerPixel(format),
          format,
          8,
          mask};
}

}  // namespace fathom

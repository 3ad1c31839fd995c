#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/images/image_samples.hpp"

namespace fathom::topside {

// One image on its own, ready for stereo: without a mission there is no model of its lighting.
struct LooseImage {
  int width = 0, height = 0;                // [px]
  PixelFormat format = PixelFormat::kMono;  // as read
  int bits = 8;                             // as read
  std::vector<std::uint8_t> mono;           // width * height
  std::vector<std::uint8_t> rgb;            // width * height * 3

  [[nodiscard]] ImageView monoView() const;
  [[nodiscard]] ImageView rgbView() const;
};

// Samples of more than 8 bits are stretched to 8 by one gain and offset for each channel; images of 8 bits
// stay as they are. Throws InputError, also when the size is not the camera's.
[[nodiscard]] LooseImage readLooseImage(const std::filesystem::path& path, Samples samples,
                                        const Camera& camera);

}  // namespace fathom::topside

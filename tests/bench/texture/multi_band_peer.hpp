#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/rgb_image.hpp"

namespace fathom::surface {

// OpenCV's multi-band blender (Burt & Adelson's pyramids with hard seams between the images) over the same
// texels. `layers`: the texture of one view each; `region`: which view (its place in `layers`, plus 1) a
// texel shows when unblended, 0 for none; `seen`: texels that a layer has. Without OpenCV's stitching module:
// empty.
[[nodiscard]] RgbImage multiBandPeer(const std::vector<RgbImage>& layers,
                                     const std::vector<std::vector<std::uint8_t>>& seen,
                                     const std::vector<std::uint64_t>& region);

}  // namespace fathom::surface

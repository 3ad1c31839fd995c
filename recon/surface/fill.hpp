#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/rgb_image.hpp"

namespace fathom::surface {

// Gives texels without a colour the mean of those around them, nearer ones first (pull and push through a
// pyramid of halves), so that mipmaps and compression meet no edges that are not there. `known`: one byte a
// texel, 0 where `image` has no colour. An image that knows none stays as it is.
void fillUnknown(RgbImage& image, const std::vector<std::uint8_t>& known);

}  // namespace fathom::surface

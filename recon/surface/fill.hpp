#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::surface {

// Gives texels without a colour the mean of the nearest known ones (pull and push through a pyramid of
// halves), so that mipmaps and compression meet no false edges. `known`: one byte a texel, 0 where `image`
// has no colour. Without known texels the image stays as it is.
void fillUnknown(RgbImage& image, const std::vector<std::uint8_t>& known);

// A grid of colours, four values a place (the fourth unused), some of them unknown.
struct ColourGrid {
  int width = 0, height = 0;
  std::vector<float> values;        // 4 * width * height
  std::vector<std::uint8_t> known;  // width * height
};

// Gives every unknown place a colour that runs smoothly between the known ones around it: halved grids down
// to one place, each unknown place from between four of the next coarser grid (pull and push, Gortler et al.
// 1996). False, and nothing done, where no place is known.
bool fillSmoothly(ColourGrid& grid);

}  // namespace fathom::surface

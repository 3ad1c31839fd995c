#pragma once

#include <cstdint>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/surface/atlas.hpp"

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

// The texture of a coarser tile from its children's (each with an atlas, whole or reduced by quarterAtlas()):
// for each texel the nearest child surface along the chart's axis. Texels that no child covers take their
// neighbours' colour.
[[nodiscard]] RgbImage bakeFromChildren(const Atlas& parent,
                                        const std::vector<const TexturedTile*>& children);

// The same tile with an atlas of a quarter the edge (mean of 4 x 4), enough to bake its parent.
[[nodiscard]] TexturedTile quarterAtlas(const TexturedTile& tile);

// Gives the vertices of a tile with an atlas (whole or reduced) the mean colour of the texture about them, up
// to the middle of their edges.
void colourVertices(TexturedTile& tile);

}  // namespace fathom::surface

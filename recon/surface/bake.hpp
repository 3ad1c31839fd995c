#pragma once

#include <vector>

#include "recon/surface/atlas.hpp"

namespace fathom::surface {

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

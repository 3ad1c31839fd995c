#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/textured_tile.hpp"

namespace fathom::surface {

// A rectangle of the atlas: faces that look about the same way, drawn along one axis. The texel (column, row)
// of the chart stands for origin + column * right + row * down, moved along `along` onto the surface.
struct Chart {
  int x = 0, y = 0, width = 0, height = 0;     // in the atlas, gutters included [texels]
  Eigen::Vector3d origin, right, down, along;  // nav [m]; right and down one texel long
};

// What one texel shows.
struct Texel {
  std::int32_t face = -1;  // of tile.surface.mesh.triangles; -1: nothing
  Eigen::Vector3f point =
      Eigen::Vector3f::Zero();  // on that face's plane (gutters: on its extension) [m, nav]
};

struct AtlasConfig {
  double texel = 0.0012;  // wanted edge on the surface [m]; enlarged where the atlas would be larger than:
  int max_edge = 4096;    // [texels]
  int gutter = 4;         // texels around a chart that continue its faces, for filters and mipmaps
};

// A side of a face, from its corner `side` to the next, beyond which the face's chart has no other.
struct Rim {
  std::uint32_t face = 0, side = 0;
};

// The tile with texture coordinates and the charts of its atlas (its image still empty). Width and height are
// multiples of 4. No two faces of a chart hide each other along its axis.
struct Atlas {
  TexturedTile tile;
  std::vector<Chart> charts;
  std::vector<std::uint16_t> chart_of_face;
  std::vector<Rim> rims;
  int gutter = 0;             // [texels]
  int width = 0, height = 0;  // [texels]
};
[[nodiscard]] Atlas makeAtlas(const TileMesh& surface, const AtlasConfig& config);

// Which face each texel shows and where: rows [first_row, first_row + rows) of the atlas, `width` texels
// each. A texel shows what its centre meets; those within the gutter around a chart's faces continue the
// nearest of them. Rows drawn apart are the same as drawn together.
void rasterise(const Atlas& atlas, int first_row, int rows, std::vector<Texel>& texels);

// The texture of a coarser tile, drawn from its children's (each with an atlas, whole or as quarterAtlas made
// it): for each texel the nearest child surface along the chart's axis. Texels that no child covers take
// their neighbours' colour.
[[nodiscard]] RgbImage bakeFromChildren(const Atlas& parent,
                                        const std::vector<const TexturedTile*>& children);

// The same tile with an atlas of a quarter the edge (mean of 4 x 4), enough to bake its parent.
[[nodiscard]] TexturedTile quarterAtlas(const TexturedTile& tile);

// Gives the vertices of a tile with an atlas (whole or reduced) its colours: each the mean of the texture
// about it, half way to its neighbours.
void colourVertices(TexturedTile& tile);

}  // namespace fathom::surface

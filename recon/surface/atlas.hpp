#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::surface {

// A rectangle of the atlas with faces of similar direction, projected along one axis. Texel (column, row) of
// the chart is at origin + column * right + row * down, moved along `along` onto the surface.
struct Chart {
  int x = 0, y = 0, width = 0, height = 0;     // in the atlas, gutters included [texels]
  Eigen::Vector3d origin, right, down, along;  // nav [m]; right and down one texel long
};

// What one texel shows.
struct Texel {
  std::int32_t face = -1;  // of tile.surface.mesh.triangles; -1: nothing
  // On that face's plane (gutters: on its extension) [m, nav].
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
};

struct AtlasConfig {
  double texel = 0.0012;  // wanted edge on the surface [m]; enlarged if the atlas would exceed max_edge
  int max_edge = 4096;    // [texels]
  int gutter = 4;         // texels around a chart that continue its faces, for filters and mipmaps
};

// A side of a face, from its corner `side` to the next, at the border of the face's chart.
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

// Finds the face and point of each texel of the rows [first_row, first_row + rows) of the atlas, `width`
// texels each. A texel shows the face at its centre; texels of the gutter continue the nearest face of the
// chart. The result does not depend on how rows are divided into calls.
void rasterise(const Atlas& atlas, int first_row, int rows, std::vector<Texel>& texels);

}  // namespace fathom::surface

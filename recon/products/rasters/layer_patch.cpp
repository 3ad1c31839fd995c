#include "recon/products/rasters/layer_patch.hpp"

#include <limits>
#include <stdexcept>

#include "recon/geometry/triangles.hpp"

namespace fathom::topside {
namespace {

constexpr int kMaxSamples = 4;  // along a mosaic cell's side: more would not change a mean of 8 bits

// A window whose cells are `parts` times smaller, and which of a mesh's corners stand where in it.
std::array<Eigen::Vector2d, 3> cornersIn(const CellWindow& window, double cell, int parts, const Mesh& mesh,
                                         const std::array<std::uint32_t, 3>& triangle) {
  std::array<Eigen::Vector2d, 3> p;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3f& v = mesh.vertices[triangle[k]];
    p[k] = {(static_cast<double>(v.x()) / cell - window.x) * parts - 0.5,
            (static_cast<double>(v.y()) / cell - window.y) * parts - 0.5};
  }
  return p;
}

float mixed(const std::array<double, 3>& w, float a, float b, float c) {
  return static_cast<float>(w[0]) * a + static_cast<float>(w[1]) * b + static_cast<float>(w[2]) * c;
}

void drawSurface(const TileMesh& tile, LayerPatch& patch) {
  const Mesh& mesh = tile.mesh;
  const std::size_t cells = patch.surface.cells();
  patch.elevation.assign(cells, kNoValue);
  patch.sigma.assign(cells, kNoValue);
  patch.views.assign(cells, 0);
  for (const auto& t : mesh.triangles) {
    const std::uint32_t a = t[0], b = t[1], c = t[2];
    const auto corners = cornersIn(patch.surface, patch.cells.surface, 1, mesh, t);
    scanTriangle(
        corners, patch.surface.rows, patch.surface.columns,
        [&](int row, int column, const std::array<double, 3>& w) {
          const std::size_t at = patch.surface.at(row, column);
          const float up = -mixed(w, mesh.vertices[a].z(), mesh.vertices[b].z(), mesh.vertices[c].z());
          if (up <= patch.elevation[at]) return;  // false where nothing is known yet
          patch.elevation[at] = up;
          if (!mesh.sigma.empty()) patch.sigma[at] = mixed(w, mesh.sigma[a], mesh.sigma[b], mesh.sigma[c]);
          if (!tile.views.empty())
            patch.views[at] =
                static_cast<std::uint16_t>(mixed(w, tile.views[a], tile.views[b], tile.views[c]) + 0.5F);
        });
  }
}

struct Colour {
  float r = 0, g = 0, b = 0;
};

// Between the four texels around a place; texture coordinates as Mesh has them.
Colour colourAt(const RgbImage& image, float s, float t) {
  const float x =
      std::clamp(s * static_cast<float>(image.width) - 0.5F, 0.0F, static_cast<float>(image.width - 1));
  const float y = std::clamp((1 - t) * static_cast<float>(image.height) - 0.5F, 0.0F,
                             static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
  const float u = x - static_cast<float>(x0), v = y - static_cast<float>(y0);
  const std::uint8_t *a = image.at(x0, y0), *b = image.at(x1, y0), *c = image.at(x0, y1),
                     *d = image.at(x1, y1);
  const auto mix = [&](int k) {
    return (1 - v) * ((1 - u) * a[k] + u * b[k]) + v * ((1 - u) * c[k] + u * d[k]);
  };
  return {mix(0), mix(1), mix(2)};
}

void drawMosaic(const TexturedTile& leaf, LayerPatch& patch) {
  const Mesh& mesh = leaf.surface.mesh;
  const bool textured = !leaf.atlas.empty() && mesh.texture_coordinates.size() == mesh.vertices.size();
  const bool coloured = mesh.colours.size() == mesh.vertices.size();
  patch.rgba.assign(4 * patch.mosaic.cells(), 0);
  if (!textured && !coloured) return;
  int parts = 1;
  if (textured && leaf.texel > 0)
    parts = std::clamp(static_cast<int>(std::lround(patch.cells.mosaic / leaf.texel)), 1, kMaxSamples);
  CellWindow fine = patch.mosaic;
  fine.rows *= parts;
  fine.columns *= parts;
  struct Sample {
    float depth = std::numeric_limits<float>::infinity();
    Colour colour;
  };
  std::vector<Sample> samples(fine.cells());
  for (const auto& t : mesh.triangles) {
    const std::uint32_t a = t[0], b = t[1], c = t[2];
    const auto corners = cornersIn(patch.mosaic, patch.cells.mosaic, parts, mesh, t);
    scanTriangle(corners, fine.rows, fine.columns, [&](int row, int column, const std::array<double, 3>& w) {
      Sample& sample = samples[fine.at(row, column)];
      const float depth = mixed(w, mesh.vertices[a].z(), mesh.vertices[b].z(), mesh.vertices[c].z());
      if (depth >= sample.depth) return;
      sample.depth = depth;
      if (textured) {
        const auto &pa = mesh.texture_coordinates[a], &pb = mesh.texture_coordinates[b],
                   &pc = mesh.texture_coordinates[c];
        sample.colour =
            colourAt(leaf.atlas, mixed(w, pa.x(), pb.x(), pc.x()), mixed(w, pa.y(), pb.y(), pc.y()));
      } else {
        const auto channel = [&](std::size_t k) {
          return mixed(w, mesh.colours[a][k], mesh.colours[b][k], mesh.colours[c][k]);
        };
        sample.colour = {channel(0), channel(1), channel(2)};
      }
    });
  }
  for (int row = 0; row < patch.mosaic.rows; ++row) {
    for (int column = 0; column < patch.mosaic.columns; ++column) {
      Colour sum;
      float known = 0;
      for (int i = 0; i < parts; ++i) {
        for (int j = 0; j < parts; ++j) {
          const Sample& sample = samples[fine.at(row * parts + i, column * parts + j)];
          if (!std::isfinite(sample.depth)) continue;
          known += 1;
          sum.r += sample.colour.r;
          sum.g += sample.colour.g;
          sum.b += sample.colour.b;
        }
      }
      if (known == 0) continue;
      std::uint8_t* to = &patch.rgba[4 * patch.mosaic.at(row, column)];
      to[0] = static_cast<std::uint8_t>(sum.r / known + 0.5F);
      to[1] = static_cast<std::uint8_t>(sum.g / known + 0.5F);
      to[2] = static_cast<std::uint8_t>(sum.b / known + 0.5F);
      to[3] = 255;
    }
  }
}

}  // namespace

CellWindow cellsOf(const TileId& tile, const TileGrid& grid, double cell) {
  // Tiles meet on the lattice's nearest plane to their border; the middle of cell k is at k + 1/2.
  const auto box = grid.box(tile);
  const auto first = [&](double border) {
    return static_cast<std::int32_t>(std::ceil(TileGrid::snap(border) / cell - 0.5));
  };
  const CellWindow window{first(box[0]), first(box[1]), 0, 0};
  return {window.x, window.y, first(box[2]) - window.x, first(box[3]) - window.y};
}

LayerPatch makeLayerPatch(const TexturedTile& leaf, const TileGrid& grid, const LayerCells& cells) {
  if (!(cells.surface > 0) || !(cells.mosaic > 0))
    throw std::invalid_argument("cells of layers must be above zero");
  if (leaf.surface.tile.level != 0) throw std::invalid_argument("layers are drawn from leaf tiles");
  LayerPatch patch;
  patch.tile = leaf.surface.tile;
  patch.cells = cells;
  patch.surface = cellsOf(patch.tile, grid, cells.surface);
  patch.mosaic = cellsOf(patch.tile, grid, cells.mosaic);
  drawSurface(leaf.surface, patch);
  drawMosaic(leaf, patch);
  return patch;
}

}  // namespace fathom::topside

#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "recon/geometry/tile_mesh.hpp"

namespace fathom::topside {

// Edges of the layers' square cells [m]. A cell covers north [x, x + 1) and east [y, y + 1) of a lattice that
// begins at nav's origin, whatever the tile, so that patches join; it belongs to the tile that holds its
// middle.
struct LayerCells {
  double surface = 0.033;  // elevation and what is derived from it
  double mosaic = 0.005;   // orthomosaic
  bool operator==(const LayerCells&) const = default;
};

// A rectangle of cells: north from x, east from y.
struct CellWindow {
  std::int32_t x = 0, y = 0, rows = 0, columns = 0;
  [[nodiscard]] std::size_t cells() const {
    return static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
  }
  [[nodiscard]] std::size_t at(std::int32_t row, std::int32_t column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  bool operator==(const CellWindow&) const = default;
};

// The cells that belong to a leaf tile.
[[nodiscard]] CellWindow cellsOf(const TileId& tile, const TileGrid& grid, double cell);

// The value of a cell without surface.
inline constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

// One leaf tile drawn from above: rows from low to high north, columns from low to high east. What is
// uppermost is seen; under an overhang nothing is. NaN (mosaic: alpha 0) where there is no surface.
struct LayerPatch {
  TileId tile;
  LayerCells cells;
  CellWindow surface, mosaic;
  std::vector<float> elevation;      // up, -depth [m], at the cell's middle
  std::vector<float> sigma;          // of the height [m]; NaN where unknown
  std::vector<std::uint16_t> views;  // meshes that saw it
  std::vector<std::uint8_t> rgba;    // mean colour of the cell, alpha 0 or 255
};

// `leaf`: as the blender textured it, or as quarterAtlas reduced it when its texels stay below a mosaic cell
// (cheaper and as good); without an atlas by its vertices' colours. Throws std::invalid_argument for cells
// that are not above zero or a tile that is no leaf.
[[nodiscard]] LayerPatch makeLayerPatch(const TexturedTile& leaf, const TileGrid& grid,
                                        const LayerCells& cells);

// For the work folder: deflated, heights to 0.1 mm. The same patch gives the same bytes.
[[nodiscard]] std::vector<std::uint8_t> packLayerPatch(const LayerPatch& patch);

enum class PatchPart : std::uint8_t { kSurface, kMosaic, kBoth };
// The part asked for; the other's vectors are empty. Throws std::runtime_error for bytes that are none.
[[nodiscard]] LayerPatch unpackLayerPatch(std::span<const std::uint8_t> bytes, PatchPart part);

}  // namespace fathom::topside

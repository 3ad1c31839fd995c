#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "recon/products/rasters/layer_patch.hpp"

namespace fathom::topside {

// The patches of a whole dive as two rasters that can be read anywhere. Unpacked patches are kept up to
// kKeptBytes, the least recently read go first. One thread at a time.
class PatchMosaic {
 public:
  using Source = std::function<std::vector<std::uint8_t>(const TileId&)>;  // packed; empty: none

  PatchMosaic(const TileGrid& grid, const LayerCells& cells, const std::vector<TileId>& tiles, Source source);

  // What the tiles cover; empty windows without tiles.
  [[nodiscard]] const CellWindow& surfaceExtent() const { return surface_extent_; }
  [[nodiscard]] const CellWindow& mosaicExtent() const { return mosaic_extent_; }
  // Whether any tile has cells of such a size in the window.
  [[nodiscard]] bool touches(const CellWindow& window, double cell) const;

  struct Surface {
    std::vector<float> elevation, sigma, views;  // as LayerPatch; NaN where nothing is
  };
  // Throws std::runtime_error for a patch that is broken or has other cells.
  [[nodiscard]] Surface surface(const CellWindow& window);
  void colours(const CellWindow& window, std::uint8_t* rgba);

  static constexpr std::size_t kKeptBytes = std::size_t{64} << 20;

 private:
  struct Kept {
    std::shared_ptr<const LayerPatch> patch;
    std::list<std::pair<TileId, PatchPart>>::iterator place;
    std::size_t bytes = 0;
  };
  [[nodiscard]] std::vector<TileId> tilesIn(const CellWindow& window, double cell) const;
  [[nodiscard]] std::shared_ptr<const LayerPatch> patchOf(const TileId& tile, PatchPart part);

  TileGrid grid_;
  LayerCells cells_;
  std::set<TileId> tiles_;
  Source source_;
  CellWindow surface_extent_, mosaic_extent_;
  std::map<std::pair<TileId, PatchPart>, Kept> kept_;
  std::list<std::pair<TileId, PatchPart>> recent_;  // newest first
  std::size_t kept_bytes_ = 0;
};

}  // namespace fathom::topside

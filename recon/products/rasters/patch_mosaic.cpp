#include "recon/products/rasters/patch_mosaic.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::topside {
namespace {

// Cells that two windows share.
CellWindow shared(const CellWindow& a, const CellWindow& b) {
  CellWindow out{std::max(a.x, b.x), std::max(a.y, b.y), 0, 0};
  out.rows = std::max(0, std::min(a.x + a.rows, b.x + b.rows) - out.x);
  out.columns = std::max(0, std::min(a.y + a.columns, b.y + b.columns) - out.y);
  return out;
}

CellWindow around(const CellWindow& a, const CellWindow& b) {
  if (a.cells() == 0) return b;
  CellWindow out{std::min(a.x, b.x), std::min(a.y, b.y), 0, 0};
  out.rows = std::max(a.x + a.rows, b.x + b.rows) - out.x;
  out.columns = std::max(a.y + a.columns, b.y + b.columns) - out.y;
  return out;
}

}  // namespace

PatchMosaic::PatchMosaic(const TileGrid& grid, const LayerCells& cells, const std::vector<TileId>& tiles,
                         Source source)
    : grid_(grid), cells_(cells), tiles_(tiles.begin(), tiles.end()), source_(std::move(source)) {
  for (const TileId& tile : tiles_) {
    surface_extent_ = around(surface_extent_, cellsOf(tile, grid, cells.surface));
    mosaic_extent_ = around(mosaic_extent_, cellsOf(tile, grid, cells.mosaic));
  }
}

std::vector<TileId> PatchMosaic::tilesIn(const CellWindow& window, double cell) const {
  std::vector<TileId> out;
  if (window.cells() == 0) return out;
  const TileId low = grid_.at(0, window.x * cell, window.y * cell);
  const TileId high = grid_.at(0, (window.x + window.rows) * cell, (window.y + window.columns) * cell);
  for (std::int32_t x = low.x - 1; x <= high.x + 1; ++x)  // by a cell beyond: borders are snapped
    for (auto it = tiles_.lower_bound({0, x, low.y - 1});
         it != tiles_.end() && it->x == x && it->y <= high.y + 1; ++it)
      if (shared(window, cellsOf(*it, grid_, cell)).cells() > 0) out.push_back(*it);
  return out;
}

bool PatchMosaic::touches(const CellWindow& window, double cell) const {
  return !tilesIn(window, cell).empty();
}

std::shared_ptr<const LayerPatch> PatchMosaic::patchOf(const TileId& tile, PatchPart part) {
  const std::pair key(tile, part);
  const auto found = kept_.find(key);
  if (found != kept_.end()) {
    recent_.splice(recent_.begin(), recent_, found->second.place);
    return found->second.patch;
  }
  Kept kept;
  const std::vector<std::uint8_t> bytes = source_(tile);
  if (!bytes.empty()) {
    auto patch = std::make_shared<LayerPatch>(unpackLayerPatch(bytes, part));
    if (!(patch->cells == cells_) || patch->tile != tile ||
        patch->surface != cellsOf(tile, grid_, cells_.surface) ||
        patch->mosaic != cellsOf(tile, grid_, cells_.mosaic))
      throw std::runtime_error("layer patch of another tile or of other cells, for tile " +
                               std::to_string(tile.x) + "_" + std::to_string(tile.y));
    kept.bytes = 10 * patch->elevation.size() + patch->rgba.size();
    kept.patch = std::move(patch);
  }
  recent_.push_front(key);
  kept.place = recent_.begin();
  kept_bytes_ += kept.bytes;
  auto result = kept.patch;
  kept_.emplace(key, std::move(kept));
  while (kept_bytes_ > kKeptBytes && recent_.size() > 1) {
    const auto oldest = kept_.find(recent_.back());
    kept_bytes_ -= oldest->second.bytes;
    kept_.erase(oldest);
    recent_.pop_back();
  }
  return result;
}

PatchMosaic::Surface PatchMosaic::surface(const CellWindow& window) {
  Surface out;
  for (auto* values : {&out.elevation, &out.sigma, &out.views}) values->assign(window.cells(), kNoValue);
  for (const TileId& tile : tilesIn(window, cells_.surface)) {
    const auto patch = patchOf(tile, PatchPart::kSurface);
    if (!patch) continue;
    const CellWindow common = shared(window, patch->surface);
    for (std::int32_t x = common.x; x < common.x + common.rows; ++x) {
      std::size_t from = patch->surface.at(x - patch->surface.x, common.y - patch->surface.y);
      std::size_t to = window.at(x - window.x, common.y - window.y);
      for (std::int32_t k = 0; k < common.columns; ++k, ++from, ++to) {
        if (std::isnan(patch->elevation[from])) continue;
        out.elevation[to] = patch->elevation[from];
        out.sigma[to] = patch->sigma[from];
        if (patch->views[from] > 0) out.views[to] = patch->views[from];
      }
    }
  }
  return out;
}

void PatchMosaic::colours(const CellWindow& window, std::uint8_t* rgba) {
  std::fill(rgba, rgba + 4 * window.cells(), std::uint8_t{0});
  for (const TileId& tile : tilesIn(window, cells_.mosaic)) {
    const auto patch = patchOf(tile, PatchPart::kMosaic);
    if (!patch) continue;
    const CellWindow common = shared(window, patch->mosaic);
    for (std::int32_t x = common.x; x < common.x + common.rows; ++x) {
      const auto from =
          patch->rgba.begin() +
          static_cast<std::ptrdiff_t>(4 * patch->mosaic.at(x - patch->mosaic.x, common.y - patch->mosaic.y));
      std::copy(from, from + 4 * static_cast<std::ptrdiff_t>(common.columns),
                rgba + 4 * window.at(x - window.x, common.y - window.y));
    }
  }
}

}  // namespace fathom::topside

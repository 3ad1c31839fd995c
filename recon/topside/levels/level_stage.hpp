#pragma once

#include <map>
#include <memory>
#include <vector>

#include "recon/topside/config/model_settings.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/pieces/tile_blocks.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// Where the tiles of one level are: in the work files of pieces or of single parents.
using TilePlaces = std::map<TileId, std::shared_ptr<const WorkFile>>;

// The tiles of the next level with their children. Empty when `tiles` is the coarsest level: one tile, or
// tiles about nav's origin that no square of the next level holds together.
[[nodiscard]] std::map<TileId, std::vector<TileId>> parentsOf(const TilePlaces& tiles);

[[nodiscard]] Digest levelKey(const TilePlaces& places, const std::vector<TileId>& children,
                              const TopsideConfig& config, const TileGrid& grid, double texel);

// Joins a parent's children, simplifies them to the level's density, and draws their textures again at its
// texel. `texel`: of the finest level [m].
Costs makeParent(const TilePlaces& places, const TileId& parent, const std::vector<TileId>& children,
                 const TopsideConfig& config, const TileGrid& grid, double texel, WorkFileWriter& file);

}  // namespace fathom::topside

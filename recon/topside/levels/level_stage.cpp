#include "recon/topside/levels/level_stage.hpp"

#include <algorithm>
#include <cmath>

#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"
#include "recon/surface/simplify.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint32_t kLevelVersion = 3;

}  // namespace

std::map<TileId, std::vector<TileId>> parentsOf(const TilePlaces& tiles) {
  std::map<TileId, std::vector<TileId>> parents;
  if (tiles.size() <= 1) return parents;
  bool joined = false;
  for (const auto& [tile, file] : tiles) {
    std::vector<TileId>& children = parents[TileGrid::parent(tile)];
    children.push_back(tile);
    joined = joined || children.size() > 1;
  }
  // Squares on either side of nav's origin never have a common one: they stand side by side at the top once
  // each is alone in its own.
  const bool at_top =
      !joined && parents.size() <= 4 && std::all_of(parents.begin(), parents.end(), [](const auto& entry) {
        return std::abs(2 * entry.first.x + 1) == 1 && std::abs(2 * entry.first.y + 1) == 1;
      });
  if (at_top) parents.clear();
  return parents;
}

Digest levelKey(const TilePlaces& places, const std::vector<TileId>& children, const TopsideConfig& config,
                const TileGrid& grid, double texel) {
  Hasher hasher;
  hasher.add("level", kLevelVersion, grid.voxel, grid.leaf_voxels, texel);
  addModelSettings(hasher, config);
  for (const TileId& child : children)
    hasher.add(child.level, child.x, child.y, places.at(child)->digestOf("feed " + tileName(child)));
  return hasher.finish();
}

Costs makeParent(const TilePlaces& places, const TileId& parent, const std::vector<TileId>& children,
                 const TopsideConfig& config, const TileGrid& grid, double texel, WorkFileWriter& file) {
  Costs costs;
  ThreadStopwatch watch;
  std::vector<TexturedTile> tiles;
  for (const TileId& child : children) tiles.push_back(readFeed(*places.at(child), child));
  std::vector<const TileMesh*> surfaces;
  std::vector<const TexturedTile*> textures;
  for (const TexturedTile& tile : tiles) {
    surfaces.push_back(&tile.surface);
    textures.push_back(&tile);
  }
  costs["read"] = watch.lap();
  const TileMesh joined = surface::joinTiles(surfaces, grid, parent);
  TileMesh surface = surface::simplify(joined, trianglesPerSquareMetre(grid, parent.level));
  costs["simplify"] = watch.lap();
  TexturedTile tile;
  if (tiles.front().atlas.empty()) {
    tile.surface = std::move(surface);
  } else {
    surface::AtlasConfig atlas_config;
    atlas_config.texel = texel * std::pow(TileGrid::kFanOut, parent.level);
    atlas_config.max_edge = config.model.max_atlas;
    surface::Atlas atlas = surface::makeAtlas(surface, atlas_config);
    costs["atlas"] = watch.lap();
    atlas.tile.atlas = surface::bakeFromChildren(atlas, textures);
    costs["texture"] = watch.lap();
    tile = std::move(atlas.tile);
  }
  const TexturedTile reduced = tile.atlas.empty() ? tile : surface::quarterAtlas(tile);
  writeTiles(file, {packTile(tile, reduced, grid, config.model)});
  costs["encode"] = watch.lap();
  return costs;
}

}  // namespace fathom::topside

#include "recon/products/tiles/check/tile_check.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/check/border_edges.hpp"
#include "recon/products/tiles/check/tileset_reader.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"

namespace fathom::topside {
namespace {

constexpr double kRounding = 1e-6;  // of boxes [m]

// What stays of a tile once it has been looked at.
struct Looked {
  std::optional<TileId> id;  // nothing: unreadable
  TileGrid grid;
  TileBorders borders;
  std::uint64_t triangles = 0, texels = 0, bytes = 0;
  std::vector<std::string> faults;
};

std::vector<std::uint8_t> readFile(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path.string(), "", "cannot be opened");
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

void checkTexture(const std::filesystem::path& path, const std::string& name, const ReadTile& tile) {
  const std::vector<std::uint8_t> bytes = readFile(path);
  const BlockTexture texture = path.extension() == ".dds" ? readDds(bytes, name) : readKtx2(bytes, name);
  if (!tile.tile.atlas.empty() &&
      (texture.width != tile.tile.atlas.width || texture.height != tile.tile.atlas.height))
    throw InputError(name, "", "is of another size than the tile's picture");
}

Looked look(const std::filesystem::path& folder, const ListedTile& listed) {
  Looked looked;
  try {
    const std::vector<std::uint8_t> bytes = readFile(folder / listed.path);
    const ReadTile read = readGlb(bytes, listed.path);
    const TileMesh& surface = read.tile.surface;
    looked.bytes = bytes.size();
    looked.triangles = surface.mesh.triangles.size();
    looked.texels = read.tile.atlas.rgb.size() / 3;
    if (tilePath(surface.tile) != listed.path)
      looked.faults.push_back(listed.path + ": holds the tile of " + tilePath(surface.tile));
    const TileEntry entry = entryOf(read.tile);
    const Eigen::Vector3d low{entry.low.y(), entry.low.x(), -entry.high.z()};
    const Eigen::Vector3d high{entry.high.y(), entry.high.x(), -entry.low.z()};
    if ((low.array() < listed.low.array() - kRounding).any() ||
        (high.array() > listed.high.array() + kRounding).any())
      looked.faults.push_back(listed.path + ": reaches out of its box");
    const std::array<double, 4> square = read.grid.box(surface.tile);
    if (entry.low.x() < square[0] - TileGrid::kLattice || entry.low.y() < square[1] - TileGrid::kLattice ||
        entry.high.x() > square[2] + TileGrid::kLattice || entry.high.y() > square[3] + TileGrid::kLattice)
      looked.faults.push_back(listed.path + ": reaches out of its tile's square");
    looked.borders = bordersOf(surface);
    looked.grid = read.grid;
    looked.id = surface.tile;
    if (!read.gpu_texture.empty()) {
      const std::filesystem::path beside =
          std::filesystem::path(listed.path).parent_path() / read.gpu_texture;
      looked.bytes +=
          std::filesystem::exists(folder / beside) ? std::filesystem::file_size(folder / beside) : 0;
      checkTexture(folder / beside, beside.generic_string(), read);
    }
  } catch (const InputError& error) {
    looked.faults.emplace_back(error.what());
  }
  return looked;
}

using Level = std::map<TileId, TileBorders>;

class Borders {
 public:
  Borders(TileCheck& check, const TileGrid& grid) : check_(check), grid_(grid) {}

  void between(const Level& level) {
    for (const auto& [id, borders] : level)
      for (const bool north : {true, false}) {
        const auto other = level.find({id.level, id.x + (north ? 1 : 0), id.y + (north ? 0 : 1)});
        const std::size_t side = north ? 1 : 3;
        if (other == level.end()) {
          check_.open_edges += borders[side].size();
          continue;
        }
        const BorderMatch match = matchNeighbours(borders[side], other->second[side - 1], grid_.voxel);
        check_.edges_between_tiles += match.equal;
        check_.open_edges += match.open;
        check_.cracks_between_tiles += match.cracks;
        if (match.cracks > 0) fault(id, match, side, "and " + tilePath(other->first, ""));
      }
  }

  void between(const Level& parents, const Level& children) {
    constexpr int kFanOut = TileGrid::kFanOut;
    for (const auto& [id, borders] : parents)
      for (std::size_t side = 0; side < 4; ++side) {
        std::vector<BorderEdge> below;
        bool any = false;
        const std::int32_t last = side % 2 == 0 ? 0 : kFanOut - 1;
        for (std::int32_t k = 0; k < kFanOut; ++k) {
          const TileId child{id.level - 1, kFanOut * id.x + (side < 2 ? last : k),
                             kFanOut * id.y + (side < 2 ? k : last)};
          const auto found = children.find(child);
          if (found == children.end()) continue;
          any = true;
          below.insert(below.end(), found->second[side].begin(), found->second[side].end());
        }
        if (!any && borders[side].empty()) continue;
        const BorderMatch match = matchLevels(borders[side], std::move(below));
        check_.edges_between_levels += match.equal;
        check_.cracks_between_levels += match.cracks;
        if (match.cracks > 0) fault(id, match, side, "and the level below");
      }
  }

 private:
  void fault(const TileId& id, const BorderMatch& match, std::size_t side, const std::string& other) {
    const std::array<double, 4> box = grid_.box(id);
    const double plane = box[side == 0 ? 0 : side == 1 ? 2 : side == 2 ? 1 : 3];
    const double along = match.place[0] * TileGrid::kLattice;
    const std::string place = formatted("north %.3f east %.3f depth %.3f", side < 2 ? plane : along,
                                        side < 2 ? along : plane, match.place[1] * TileGrid::kLattice);
    check_.faults.push_back(tilePath(id, "") + " " + other + ": " + std::to_string(match.cracks) +
                            " edges do not meet, the first at " + place);
  }

  TileCheck& check_;
  TileGrid grid_;
};

void findUnlisted(const std::filesystem::path& folder, const std::vector<ListedTile>& listed,
                  TileCheck& check) {
  std::set<std::string> known, unlisted;
  for (const ListedTile& tile : listed) known.insert(tile.path);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string path = entry.path().lexically_relative(folder).generic_string();
    if (entry.path().extension() == ".glb" && !known.contains(path)) unlisted.insert(path);
    if (entry.path().extension() == ".tmp") unlisted.insert(path);
  }
  for (const std::string& path : unlisted) check.faults.push_back(path + ": no tileset lists it");
}

}  // namespace

TileCheck checkTiles(const std::filesystem::path& named) {
  const bool above = !std::filesystem::exists(named / "tileset.json") &&
                     std::filesystem::exists(named / "tiles" / "tileset.json");
  const std::filesystem::path folder = above ? named / "tiles" : named;
  ReadTilesets read = readTilesets(folder);
  TileCheck check;
  check.tiles = read.tiles.size();
  check.tileset_files = read.files;
  check.faults = std::move(read.faults);

  std::vector<Looked> looked(read.tiles.size());
  tbb::parallel_for(std::size_t{0}, looked.size(),
                    [&](std::size_t k) { looked[k] = look(folder, read.tiles[k]); });
  std::map<int, Level> levels;
  std::optional<TileGrid> grid;
  for (std::size_t k = 0; k < looked.size(); ++k) {
    Looked& tile = looked[k];
    check.triangles += tile.triangles;
    check.texels += tile.texels;
    check.bytes += tile.bytes;
    std::move(tile.faults.begin(), tile.faults.end(), std::back_inserter(check.faults));
    if (!tile.id) continue;
    if (!grid) grid = tile.grid;
    if (tile.grid.voxel != grid->voxel || tile.grid.leaf_voxels != grid->leaf_voxels)
      check.faults.push_back(read.tiles[k].path + ": is of another grid than the first tile");
    else
      levels[tile.id->level].try_emplace(*tile.id, std::move(tile.borders));
  }
  check.levels = levels.size();
  if (grid) {
    Borders borders(check, *grid);
    for (const auto& [number, level] : levels) {
      borders.between(level);
      if (const auto below = levels.find(number - 1); below != levels.end())
        borders.between(level, below->second);
    }
  }
  findUnlisted(folder, read.tiles, check);
  return check;
}

}  // namespace fathom::topside

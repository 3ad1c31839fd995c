#include "recon/products/tiles/check/tile_check.hpp"

#include <tbb/parallel_for.h>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/check/tileset_reader.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"

namespace fathom::topside {
namespace {

BorderEdge turned(const BorderEdge& edge) {
  return {edge.to, edge.from};
}

std::int32_t steps(float metres) {
  return static_cast<std::int32_t>(std::lround(static_cast<double>(metres) / TileGrid::kLattice));
}

std::vector<BorderEdge> without(const std::vector<BorderEdge>& all, const std::vector<BorderEdge>& those) {
  std::vector<BorderEdge> rest;
  std::set_difference(all.begin(), all.end(), those.begin(), those.end(), std::back_inserter(rest));
  return rest;
}

// Where two cells meet along an edge only, fusion makes a vertex twice, a step apart; surfaces that end there
// on both sides of a plane overlap by that much and do not belong together.
constexpr double kTouch = 2;  // [steps]

// Whether edges of tiles on both sides of a plane, one of them turned round, are meant to be one line: they
// run over a common stretch as seen along `a`, less than `near` steps apart. Stretches are measured along the
// edge and not along the side, for on a steep surface all of a hole's outline stands over a few steps of the
// side.
bool beside(const BorderEdge& a, const BorderEdge& b, std::int64_t near) {
  if (a == turned(b)) return true;  // the same edge by a face of the opposite orientation
  const auto from = [&](const std::array<std::int32_t, 2>& place) {
    return Eigen::Vector2d(place[0] - a.from[0], place[1] - a.from[1]);
  };
  const double length = from(a.to).norm();
  const Eigen::Vector2d along = from(a.to) / length, across(-along.y(), along.x());
  const Eigen::Vector2d first = from(b.from), last = from(b.to);
  const double s0 = first.dot(along), s1 = last.dot(along);
  const double begin = std::max(s0, 0.0), end = std::min(s1, length);
  if (begin + kTouch >= end) return false;
  const auto distance = [&](double s) {
    return std::lerp(first.dot(across), last.dot(across), (s - s0) / (s1 - s0));
  };
  const double d0 = distance(begin), d1 = distance(end);
  return d0 * d1 <= 0 || std::min(std::abs(d0), std::abs(d1)) < static_cast<double>(near);
}

}  // namespace

TileBorders bordersOf(const TileMesh& tile) {
  TileBorders borders;
  const auto& vertices = tile.mesh.vertices;
  for (std::size_t side = 0; side < borders.size(); ++side) {
    const auto bit = static_cast<std::uint8_t>(1U << side);
    const Eigen::Index along = side < 2 ? 1 : 0;
    std::vector<BorderEdge> edges;
    for (const auto& triangle : tile.mesh.triangles)
      for (std::size_t c = 0; c < 3; ++c) {
        const std::uint32_t a = triangle[c], b = triangle[(c + 1) % 3];
        if ((tile.shared[a] & tile.shared[b] & bit) == 0) continue;
        const BorderEdge edge{{steps(vertices[a][along]), steps(vertices[a].z())},
                              {steps(vertices[b][along]), steps(vertices[b].z())}};
        if (edge.from != edge.to) edges.push_back(edge);
      }
    std::sort(edges.begin(), edges.end());
    // An edge that is there reversed, too, has the surface on both its sides.
    std::vector<BorderEdge> back(edges);
    for (BorderEdge& edge : back) edge = turned(edge);
    std::sort(back.begin(), back.end());
    borders[side] = without(edges, back);
  }
  return borders;
}

BorderMatch matchNeighbours(const std::vector<BorderEdge>& here, const std::vector<BorderEdge>& there,
                            double voxel) {
  std::vector<BorderEdge> back(there);
  for (BorderEdge& edge : back) edge = turned(edge);
  std::sort(back.begin(), back.end());
  const std::vector<BorderEdge> mine = without(here, back), yours = without(back, here);
  BorderMatch match;
  match.equal = here.size() - mine.size();
  const auto near = static_cast<std::int64_t>(std::lround(2 * voxel / TileGrid::kLattice));
  for (const BorderEdge& edge : mine) {
    const bool crack = std::any_of(yours.begin(), yours.end(),
                                   [&](const BorderEdge& other) { return beside(edge, other, near); });
    if (crack && match.cracks == 0) match.place = edge.from;
    ++(crack ? match.cracks : match.open);
  }
  for (const BorderEdge& edge : yours)
    if (std::none_of(mine.begin(), mine.end(),
                     [&](const BorderEdge& other) { return beside(edge, other, near); }))
      ++match.open;
  return match;
}

BorderMatch matchLevels(const std::vector<BorderEdge>& parent, std::vector<BorderEdge> children) {
  std::sort(children.begin(), children.end());
  const std::vector<BorderEdge> lost = without(children, parent), invented = without(parent, children);
  BorderMatch match;
  match.equal = parent.size() - invented.size();
  match.cracks = lost.size() + invented.size();
  if (!lost.empty()) match.place = lost.front().from;
  if (lost.empty() && !invented.empty()) match.place = invented.front().from;
  return match;
}

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

// Sides of a tile as TileBorders counts them: low north is the south side, low east the west side.
enum Side : std::size_t { kSouth, kNorth, kWest, kEast };
constexpr Side kSides[] = {kSouth, kNorth, kWest, kEast};

// The `k`th of the children that reach to a side of a tile.
TileId childAt(const TileId& id, Side side, std::int32_t k) {
  constexpr std::int32_t kLast = TileGrid::kFanOut - 1;
  const TileId first{id.level - 1, TileGrid::kFanOut * id.x, TileGrid::kFanOut * id.y};
  switch (side) {
    case kSouth:
      return {first.level, first.x, first.y + k};
    case kNorth:
      return {first.level, first.x + kLast, first.y + k};
    case kWest:
      return {first.level, first.x + k, first.y};
    default:
      return {first.level, first.x + k, first.y + kLast};
  }
}

class Borders {
 public:
  Borders(TileCheck& check, const TileGrid& grid) : check_(check), grid_(grid) {}

  void between(const Level& level) {
    for (const auto& [id, borders] : level) {
      meet(level, id, borders, kNorth, {id.level, id.x + 1, id.y}, kSouth);
      meet(level, id, borders, kEast, {id.level, id.x, id.y + 1}, kWest);
    }
  }

  void between(const Level& parents, const Level& children) {
    for (const auto& [id, borders] : parents)
      for (const Side side : kSides) {
        std::vector<BorderEdge> below;
        bool any = false;
        for (std::int32_t k = 0; k < TileGrid::kFanOut; ++k) {
          const auto child = children.find(childAt(id, side, k));
          if (child == children.end()) continue;
          any = true;
          below.insert(below.end(), child->second[side].begin(), child->second[side].end());
        }
        if (!any && borders[side].empty()) continue;
        const BorderMatch match = matchLevels(borders[side], std::move(below));
        check_.edges_between_levels += match.equal;
        check_.cracks_between_levels += match.cracks;
        if (match.cracks > 0) fault(id, match, side, "and the level below");
      }
  }

 private:
  // One side of a tile and the side of the neighbour that it is at.
  void meet(const Level& level, const TileId& id, const TileBorders& borders, Side side, const TileId& beside,
            Side its_side) {
    const auto other = level.find(beside);
    if (other == level.end()) {
      check_.open_edges += borders[side].size();
      return;
    }
    const BorderMatch match = matchNeighbours(borders[side], other->second[its_side], grid_.voxel);
    check_.edges_between_tiles += match.equal;
    check_.open_edges += match.open;
    check_.cracks_between_tiles += match.cracks;
    if (match.cracks > 0) fault(id, match, side, "and " + tilePath(beside, ""));
  }

  void fault(const TileId& id, const BorderMatch& match, Side side, const std::string& other) {
    const auto [low_north, low_east, high_north, high_east] = grid_.box(id);
    const double along = match.place[0] * TileGrid::kLattice, down = match.place[1] * TileGrid::kLattice;
    double north = along, east = along;
    if (side == kSouth) north = low_north;
    if (side == kNorth) north = high_north;
    if (side == kWest) east = low_east;
    if (side == kEast) east = high_east;
    check_.faults.push_back(tilePath(id, "") + " " + other + ": " + std::to_string(match.cracks) +
                            " edges do not meet, the first at " +
                            formatted("north %.3f east %.3f depth %.3f", north, east, down));
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

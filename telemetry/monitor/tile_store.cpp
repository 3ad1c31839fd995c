#include "telemetry/monitor/tile_store.hpp"

#include <cmath>

#include "telemetry/tile_fragments.hpp"

namespace fathom::monitor {
namespace {

constexpr int kFinestLevel = 15;  // what the link can name
constexpr Rgb kNoColour{128, 128, 128};

bool better(const telemetry::DecodedTile& a, const telemetry::DecodedTile& b) {
  const auto ra = static_cast<std::uint16_t>(a.tile.revision),
             rb = static_cast<std::uint16_t>(b.tile.revision);
  return ra == rb ? a.stride < b.stride : telemetry::newerRevision(ra, rb);
}

std::int32_t parentIndex(std::int32_t index, int levels) {
  return static_cast<std::int32_t>(std::floor(std::ldexp(static_cast<double>(index), -levels)));
}

}  // namespace

bool TileStore::put(const telemetry::DecodedTile& tile, std::int64_t utc_ns) {
  const TileKey key{tile.tile.level, tile.tile.north_index, tile.tile.east_index};
  auto found = tiles_.find(key);
  if (found != tiles_.end() && !better(tile, found->second.content)) return false;
  if (found == tiles_.end()) {
    if (tiles_.size() >= max_tiles_) {
      ++refused_;
      return false;
    }
    found = tiles_.emplace(key, ReceivedTile{}).first;
  }
  found->second.content = tile;
  found->second.received_utc_ns = utc_ns;
  ++version_;
  changed(found->second);
  for (int up = 1; up <= key.level; ++up) {  // what this tile now hides has changed too
    const auto parent =
        tiles_.find({key.level - up, parentIndex(key.north_index, up), parentIndex(key.east_index, up)});
    if (parent != tiles_.end()) changed(parent->second);
  }
  return true;
}

void TileStore::changed(ReceivedTile& received) {
  const HeightTile tile = shown(received);
  const double edge = tile.spacing() * received.content.stride;
  const auto triangles = latticeTriangles(tile, received.content.stride).size();
  area_ -= received.area;
  received.area = static_cast<double>(triangles) * edge * edge / 2;
  area_ += received.area;
  received.version = version_;
}

HeightTile TileStore::shown(const ReceivedTile& received) const {
  HeightTile tile = received.content.tile;
  for (int level = tile.level + 1; level <= kFinestLevel; ++level) {
    const int split = 1 << (level - tile.level);  // finer tiles a side
    // Are there tiles of that level at all? The map is ordered by level.
    const auto first = tiles_.lower_bound({level, INT32_MIN, INT32_MIN});
    if (first == tiles_.end()) break;
    if (first->first.level != level) continue;
    for (int i = 0; i < HeightTile::kSide; ++i) {
      for (int j = 0; j < HeightTile::kSide; ++j) {
        const double north = static_cast<double>(i * split) / HeightTile::kCells;  // in finer tiles
        const double east = static_cast<double>(j * split) / HeightTile::kCells;
        const double floor_north = std::floor(north), floor_east = std::floor(east);
        if (north == floor_north || east == floor_east) continue;  // on a border: both show it
        const auto finer =
            tiles_.find({level, tile.north_index * split + static_cast<std::int32_t>(floor_north),
                         tile.east_index * split + static_cast<std::int32_t>(floor_east)});
        if (finer == tiles_.end()) continue;
        const int step = finer->second.content.stride;
        const auto nearest = [&](double part) {
          return static_cast<int>(std::lround(part * HeightTile::kCells / step)) * step;
        };
        if (finer->second.content.tile.at(nearest(north - floor_north), nearest(east - floor_east)).coverage >
            0)
          tile.at(i, j).coverage = 0;
      }
    }
  }
  return tile;
}

std::vector<std::array<std::size_t, 3>> latticeTriangles(const HeightTile& tile, int stride) {
  std::vector<std::array<std::size_t, 3>> triangles;
  const auto index = [](int i, int j) { return static_cast<std::size_t>(i * HeightTile::kSide + j); };
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    if (tile.nodes[a].coverage > 0 && tile.nodes[b].coverage > 0 && tile.nodes[c].coverage > 0)
      triangles.push_back({a, b, c});
  };
  for (int i = 0; i < HeightTile::kCells; i += stride) {
    for (int j = 0; j < HeightTile::kCells; j += stride) {
      const std::size_t sw = index(i, j), nw = index(i + stride, j);
      const std::size_t se = index(i, j + stride), ne = index(i + stride, j + stride);
      if (tile.nodes[sw].coverage > 0 && tile.nodes[ne].coverage > 0) {
        add(sw, se, ne);
        add(sw, ne, nw);
      } else {
        add(sw, se, nw);
        add(se, ne, nw);
      }
    }
  }
  return triangles;
}

Mesh TileStore::mesh() const {
  Mesh mesh;
  for (const auto& [key, received] : tiles_) {
    const HeightTile tile = shown(received);
    std::array<std::uint32_t, HeightTile::kNodes> vertex{};
    std::array<bool, HeightTile::kNodes> placed{};
    for (const auto& corners : latticeTriangles(tile, received.content.stride)) {
      std::array<std::uint32_t, 3> triangle{};
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t n = corners[c];
        if (!placed[n]) {
          placed[n] = true;
          vertex[n] = static_cast<std::uint32_t>(mesh.vertices.size());
          const auto i = static_cast<double>(n / HeightTile::kSide),
                     j = static_cast<double>(n % HeightTile::kSide);
          mesh.vertices.emplace_back(static_cast<float>(tile.north0() + i * tile.spacing()),
                                     static_cast<float>(tile.east0() + j * tile.spacing()),
                                     tile.nodes[n].depth);
          mesh.colours.push_back(received.content.colour_bits > 0 ? tile.nodes[n].colour : kNoColour);
          mesh.sigma.push_back(tile.nodes[n].sigma);
        }
        triangle[c] = vertex[n];
      }
      mesh.triangles.push_back(triangle);
    }
  }
  computeNormals(mesh);
  return mesh;
}

}  // namespace fathom::monitor

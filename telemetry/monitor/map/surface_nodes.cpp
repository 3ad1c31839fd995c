#include "telemetry/monitor/map/surface_nodes.hpp"

#include <algorithm>

namespace fathom::monitor {
namespace {

int nodeIndex(int code, Place p) {
  return (p.north >> code & 3) * telemetry::MapBlock::kSide + (p.east >> code & 3);
}

bool isOn(int code, Place p) {
  const Unit mask = (Unit{1} << code) - 1;
  return (p.north & mask) == 0 && (p.east & mask) == 0;
}

}  // namespace

SurfaceNodes::SurfaceNodes(const BlockStore& store, ChunkKey centre) : centre_(centre) {
  for (int n = 0; n < 3; ++n) {
    for (int e = 0; e < 3; ++e) {
      const BlockStore::Chunk* chunk = store.chunk({centre.north + n - 1, centre.east + e - 1});
      around_[static_cast<std::size_t>(n * 3 + e)] = chunk;
      if (chunk == nullptr) continue;
      for (std::size_t code = 0; code < kLevels; ++code)
        has_level_[code] = has_level_[code] || !chunk->levels[code].empty();
    }
  }
}

const StoredBlock* SurfaceNodes::blockAt(int code, Place p) const {
  const int n = (p.north >> kChunkCode) - centre_.north + 1, e = (p.east >> kChunkCode) - centre_.east + 1;
  if (n < 0 || n > 2 || e < 0 || e > 2) return nullptr;
  const BlockStore::Chunk* chunk = around_[static_cast<std::size_t>(n * 3 + e)];
  if (chunk == nullptr) return nullptr;
  const auto& level = chunk->levels[static_cast<std::size_t>(code)];
  if (level.empty()) return nullptr;
  const auto found = level.find(BlockStore::chunkSlot(
      {static_cast<telemetry::SpacingCode>(code), p.north >> (code + 2), p.east >> (code + 2)}));
  return found == level.end() ? nullptr : &found->second;
}

bool SurfaceNodes::isReceived(int code, Place p) const {
  const StoredBlock* block = blockAt(code, p);
  return block != nullptr && block->block.isSeen(nodeIndex(code, p));
}

std::optional<MapSurfacePoint> SurfaceNodes::received(int code, Place p) const {
  const StoredBlock* stored = blockAt(code, p);
  const int n = nodeIndex(code, p);
  if (stored == nullptr || !stored->block.isSeen(n)) return std::nullopt;
  const auto i = static_cast<std::size_t>(n);
  const Rgb& colour = stored->block.colour[i];
  return MapSurfacePoint{stored->block.depth[i],
                         {double(colour[0]), double(colour[1]), double(colour[2])},
                         stored->block.sigma,
                         stored->max_error,
                         stored->received_utc_ns,
                         stored->changed_utc_ns,
                         static_cast<telemetry::SpacingCode>(code),
                         stored->has_colour,
                         false};
}

int SurfaceNodes::corners(int code, Place p) const {
  const Unit s = Unit{1} << code;
  return int{isReceived(code, p)} + int{isReceived(code, {p.north + s, p.east})} +
         int{isReceived(code, {p.north, p.east + s})} + int{isReceived(code, {p.north + s, p.east + s})};
}

std::optional<MapSurfacePoint> SurfaceNodes::finest(Place p) const {
  for (int code = 0; code < kLevels && isOn(code, p); ++code)
    if (hasLevel(code))
      if (auto point = received(code, p)) return point;
  return std::nullopt;
}

std::optional<MapSurfacePoint> SurfaceNodes::at(Place p) const {
  if (auto point = finest(p)) return point;
  for (int code = 1; code < kLevels; ++code) {
    if (!hasLevel(code)) continue;
    const Unit s = Unit{1} << code, mask = s - 1;
    // On an edge two cells touch the place; at a corner that was not received no cell has all corners.
    const Place south_west{p.north & ~mask, p.east & ~mask};
    const bool on_row = (p.north & mask) == 0, on_column = (p.east & mask) == 0;
    if (on_row && on_column) continue;
    std::array<Place, 2> cells{south_west, south_west};
    if (on_row) cells[1].north -= s;
    if (on_column) cells[1].east -= s;
    for (const Place& cell : cells) {
      if (corners(code, cell) < 4) continue;
      const std::array<MapSurfacePoint, 4> at_corners{*finest(cell), *finest({cell.north, cell.east + s}),
                                                      *finest({cell.north + s, cell.east + s}),
                                                      *finest({cell.north + s, cell.east})};
      MapSurfacePoint point =
          between(at_corners, double(p.north - cell.north) / s, double(p.east - cell.east) / s);
      point.spacing = static_cast<telemetry::SpacingCode>(code);
      point.interpolated = true;
      return point;
    }
  }
  return std::nullopt;
}

MapSurfacePoint between(const std::array<MapSurfacePoint, 4>& c, double n, double e) {
  const std::array<double, 4> weight{(1 - n) * (1 - e), (1 - n) * e, n * e, n * (1 - e)};
  const std::size_t nearest =
      static_cast<std::size_t>(std::max_element(weight.begin(), weight.end()) - weight.begin());
  MapSurfacePoint point = c[nearest];
  point.depth = point.sigma = 0;
  point.has_colour = true;
  std::array<double, 3> colour{};
  for (std::size_t i = 0; i < 4; ++i) {
    if (weight[i] == 0) continue;  // a place on an edge must not depend on the cell's far side
    point.depth += weight[i] * c[i].depth;
    point.sigma += weight[i] * c[i].sigma;
    point.max_error = std::max(point.max_error, c[i].max_error);
    point.received_utc_ns = std::max(point.received_utc_ns, c[i].received_utc_ns);
    point.changed_utc_ns = std::max(point.changed_utc_ns, c[i].changed_utc_ns);
    point.has_colour = point.has_colour && c[i].has_colour;
    for (std::size_t k = 0; k < 3; ++k) colour[k] += weight[i] * c[i].colour[k];
  }
  point.colour = colour;
  return point;
}

}  // namespace fathom::monitor

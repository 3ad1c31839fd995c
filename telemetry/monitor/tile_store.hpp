#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <map>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "telemetry/tile_codec.hpp"

namespace fathom::monitor {

struct TileKey {
  int level = 0;
  std::int32_t north_index = 0, east_index = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

struct ReceivedTile {
  telemetry::DecodedTile content;
  std::int64_t received_utc_ns = 0;
  std::uint64_t version = 0;  // of the store, when this tile or what hides it changed last
  double area = 0;            // seafloor that it shows [m2]
};

// The map as received: the best content of every tile. A newer revision replaces an older one; of one
// revision the finer lattice stays. Where a finer tile shows the same seafloor, the coarser tile's nodes are
// left out.
class TileStore {
 public:
  explicit TileStore(std::size_t max_tiles = 20000) : max_tiles_(max_tiles) {}

  // False if the tile is no better than what is there, or the store is full (counted).
  bool put(const telemetry::DecodedTile& tile, std::int64_t utc_ns);

  [[nodiscard]] std::uint64_t version() const { return version_; }
  [[nodiscard]] std::size_t size() const { return tiles_.size(); }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] const std::map<TileKey, ReceivedTile>& tiles() const { return tiles_; }

  // A tile's nodes as they should be shown: those that a finer tile shows have coverage 0.
  [[nodiscard]] HeightTile shown(const ReceivedTile& tile) const;
  // Seafloor shown [m2].
  [[nodiscard]] double area() const { return area_; }
  // Everything shown, as one mesh in nav. Tiles that came without colour are grey.
  [[nodiscard]] Mesh mesh() const;

 private:
  void changed(ReceivedTile& tile);

  std::size_t max_tiles_;
  double area_ = 0;
  std::map<TileKey, ReceivedTile> tiles_;
  std::uint64_t version_ = 0;
  std::uint64_t refused_ = 0;
};

// Triangles over every stride-th node, as indices into HeightTile::nodes, counter-clockwise seen from above:
// two for a cell whose four nodes are seen, one where three are.
[[nodiscard]] std::vector<std::array<std::size_t, 3>> latticeTriangles(const HeightTile& tile, int stride);

}  // namespace fathom::monitor

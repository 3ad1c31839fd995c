#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "recon/geometry/height_tile.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct QuadtreeConfig {
  double root_size = 32.0;       // edge of a root square, level 0 [m]
  int max_level = 3;             // finest level: edge root_size / 2^max_level, nodes 1/16 of that
  int max_tiles = 4096;          // tiles of all levels in the pool
  double min_sigma = 0.005;      // floor of one observation's standard deviation [m]
};

struct TileKey {
  std::int32_t north_index = 0, east_index = 0;
  std::int16_t level = 0;
};

// The onboard map: a quadtree over nav's north-east plane whose leaves are tiles of 17 x 17 height nodes, each a
// variance-weighted mean of the observations near it (height, colour). A fixed pool of tiles; when it is full the
// least recently observed area is coarsened by a level (its four tiles become their parent), and counted.
class QuadtreeMap {
 public:
  explicit QuadtreeMap(const QuadtreeConfig& config);  // throws std::invalid_argument; the only allocation
  ~QuadtreeMap();

  // Fuses a local mesh given in nav (vertices, sigma, colours): every node under a triangle gets one observation.
  // Returns the number of nodes updated.
  std::size_t fuse(const Mesh& mesh_in_nav);

  // Leaves in a fixed order (by key).
  void forEachLeaf(const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  // A leaf, or any coarser tile averaged from the leaves below it; false if nothing was seen there. The last row and
  // column come from the neighbours.
  [[nodiscard]] bool extract(const TileKey& key, HeightTile& out) const;

  struct Counters {
    std::uint64_t observations = 0, coarsened = 0, refused = 0;
    int tiles_used = 0, tiles_high_water = 0;
    std::size_t memory_bytes = 0;  // pool and index
  };
  [[nodiscard]] Counters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All leaves as one mesh in nav.
[[nodiscard]] Mesh toMesh(const QuadtreeMap& map);

}  // namespace fathom::fusion

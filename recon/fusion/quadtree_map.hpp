#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "recon/geometry/height_tile.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct QuadtreeConfig {
  double root_size = 32.0;          // edge of a root square, level 0 [m]
  int max_level = 3;                // finest level: edge root_size / 2^max_level, nodes 1/16 of that
  int max_tiles = 4096;             // tiles of all levels in the pool
  double min_sigma = 0.005;         // floor of one observation's standard deviation [m]
  double node_spacing_ratio = 0.7;  // a tile's nodes are no closer than this times the mesh's point spacing
  double gate = 3.5;  // observations further from a known node than this many sigma are outvoted
};

struct TileKey {
  std::int32_t north_index = 0, east_index = 0;
  std::int16_t level = 0;
};

// The onboard map: a quadtree over nav's north-east plane whose leaves are tiles of 17 x 17 height nodes,
// each a variance-weighted mean of the observations near it (height, colour). A fixed pool of tiles; when it
// is full the least recently observed area is coarsened by a level (its four tiles become their parent), and
// counted.
//
// A tile's level follows the density of the points that it was seen with: dense, low passes make small tiles,
// sparse or high ones large tiles; denser data later splits a large tile while an eighth of the pool is free.
// A node belongs to the tile of its lower index, so it is stored once. A mesh gives a node the uppermost of
// its surfaces there. An observation further than the gate from a known node does not enter it, but votes; a
// node outvoted by more disagreeing than agreeing meshes starts anew (a fish passes, a wrong first sight does
// not stay). State: 32 bytes a node, 8 KiB a tile, and 100 to 400 bytes of index a tile. One thread at a
// time.
class QuadtreeMap {
 public:
  explicit QuadtreeMap(const QuadtreeConfig& config);  // throws std::invalid_argument; the only allocation
  ~QuadtreeMap();

  // Fuses a local mesh given in nav (vertices, sigma, colours): every node under a triangle gets one
  // observation, weighted by 1 / sigma^2 (min_sigma where the mesh has no sigma). Triangles with vertices
  // that are not finite or further than 100 km from the origin are skipped. Returns the number of nodes
  // updated.
  std::size_t fuse(const Mesh& mesh_in_nav);

  // Forgets all, without calls of the heap. The next fuse() has the number `fused` + 1.
  void clear(std::uint32_t fused = 0);
  // How many fuse() there were.
  [[nodiscard]] std::uint32_t fused() const;

  // Leaves in a fixed order: by level, north, east. `revision` is the number of the fuse() that last changed
  // what extract() gives for the leaf.
  void forEachLeaf(const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  // A leaf, or any coarser tile averaged from the leaves below it; false if nothing was seen there. The last
  // row and column come from the neighbours.
  [[nodiscard]] bool extract(const TileKey& key, HeightTile& out) const;

  struct Counters {
    std::uint64_t observations = 0;       // one a node and mesh
    std::uint64_t outvoted = 0;           // of those, further from the node than the gate
    std::uint64_t coarsened = 0;          // groups of tiles replaced by their parent
    std::uint64_t refused = 0;            // tiles wanted when the pool was full of level 0
    std::uint64_t skipped_triangles = 0;  // not finite, or too far
    int tiles_used = 0, tiles_high_water = 0;
    std::size_t memory_bytes = 0;  // pool and index
  };
  [[nodiscard]] Counters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All leaves as one mesh in nav; nodes that tiles share become one vertex.
[[nodiscard]] Mesh toMesh(const QuadtreeMap& map);

}  // namespace fathom::fusion

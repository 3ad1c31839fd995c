#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

struct QuadtreeConfig {
  double root_size = 32.0;          // edge of a root square, level 0: a power of two [m]
  int max_level = 3;                // finest level: edge root_size / 2^max_level, cells 1/16 of that
  int max_tiles = 4096;             // tiles of all levels in the pool
  int layers_per_tile = 208;        // layers in the pool, for each tile: a seen cell needs one, or a few
  double min_sigma = 0.005;         // floor of one observation's standard deviation [m]
  double node_spacing_ratio = 0.7;  // a mesh's cells are no smaller than this times its point spacing
  double gate = 3.5;                // layers further apart than this many sigma are two surfaces
};

struct TileKey {
  std::int32_t north_index = 0, east_index = 0;
  std::int16_t level = 0;
};

// The onboard map: a quadtree over nav's north-east plane of tiles of 16 x 16 cells that hold whole-numbered
// sums over what meshes saw there (weight, weight * height, weight * height^2, weight * colour, count). What
// a mesh gives to a cell depends on the mesh alone, so remove() takes out exactly what fuse() put in, and the
// map depends on which meshes are in it, not on the order of events.
//
// A mesh goes in at the level of its point spacing. Sums of several levels
// can stand over the same ground; the finest that saw a place is shown, and where it saw nothing the next
// coarser one is interpolated. A cell's sums are kept apart by bins of height; when read, neighbouring bins
// that agree within the gate are one surface, and of two surfaces the one with more observations is shown
// (of equals the upper), with a mark where the other has a third of its support: a fish does not bend the
// floor, nor stay once it is outvoted.
//
// When the pool is full the least valuable group of four squares (flat, seen long ago, far from the vehicle,
// known ashore) is added into its parent, which holds what is finer from then on until it is empty. Meshes
// that went in finer are still taken out exactly. Two maps of the same meshes are equal bit by bit when
// neither has coarsened, or both the same squares. A mesh for which there is no room even then is refused as
// a whole. One thread at a time.
class QuadtreeMap {
 public:
  explicit QuadtreeMap(const QuadtreeConfig& config);  // throws std::invalid_argument; the only allocation
  ~QuadtreeMap();

  // Fuses a local mesh given in nav (vertices, sigma, colours): every cell whose middle lies under a triangle
  // gets one observation, weighted by 1 / sigma^2 (min_sigma where the mesh has no sigma). Triangles with
  // vertices that are not finite or further than 100 km from the origin are skipped. Returns the number of
  // cells observed; 0 when the mesh was refused.
  std::size_t fuse(const Mesh& mesh_in_nav);
  // Takes out a mesh that was fused, and not refused, with exactly these vertices, sigma and colours.
  std::size_t remove(const Mesh& mesh_in_nav);

  // Coarsens a square as a full pool does: what is below it becomes its own. False when there is nothing
  // below, or more than one level.
  bool coarsen(const TileKey& key);
  // For the worth of areas: where the vehicle is, and squares that the ship has as they are shown.
  void noteVehicle(const Eigen::Vector2d& north_east);
  void noteSent(const TileKey& key);

  // Forgets all, without calls of the heap. The next fuse() has the number `fused` + 1.
  void clear(std::uint32_t fused = 0);
  // How many fuse() and remove() there were.
  [[nodiscard]] std::uint32_t fused() const;

  // The squares that partition what was seen, in a fixed order: by level, north, east; `finest`: squares
  // below that level count as seen from it. A leaf may hold no sums itself, where a coarser square shows
  // through beside a finer one. `revision` is the number of the last fuse(), remove() or coarsening that can
  // have changed what extract() gives for the leaf.
  void forEachLeaf(const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  void forEachLeaf(int finest,
                   const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  // Any square of any level as heights at the corners of its cells, averaged from finer cells under a tent as
  // wide as its spacing, interpolated from coarser ones; false if nothing was seen there. On a plane without
  // bias, at the border of what was seen too.
  [[nodiscard]] bool extract(const TileKey& key, HeightTile& out) const;

  // All sums as bytes in a fixed order: equal for equal maps, whatever their histories.
  [[nodiscard]] std::string canonicalBytes() const;

  struct Counters {
    std::uint64_t observations = 0;       // put in: one a cell and mesh
    std::uint64_t outvoted = 0;           // of those, not on the surface shown then
    std::uint64_t removed = 0;            // observations taken out
    std::uint64_t missing = 0;            // to be taken out, but never put in: the caller's mistake
    std::uint64_t coarsened = 0;          // groups of tiles replaced by their parent
    std::uint64_t refused = 0;            // meshes for which there was no room
    std::uint64_t skipped_triangles = 0;  // not finite, or too far
    int tiles_used = 0, tiles_high_water = 0;
    int layers_used = 0, layers_high_water = 0, layers = 0;
    std::size_t memory_bytes = 0;  // all that is held: pools, index, work space
  };
  [[nodiscard]] Counters counters() const;

  // Bit by bit, into a map of the same configuration; a map whose load() failed holds nothing of it.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All leaves as one mesh in nav without cracks: nodes that tiles share are one vertex, and a cell beside
// finer ones takes their vertices into its border.
[[nodiscard]] Mesh toMesh(const QuadtreeMap& map);
// The same with no cells finer than a level's.
[[nodiscard]] Mesh meshAt(const QuadtreeMap& map, int level);

}  // namespace fathom::fusion

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

inline constexpr int kTileCells = HeightTile::kCells;  // a side

struct QuadtreeConfig {
  double root_size = 32.0;          // edge of a root square, level 0: a power of two [m]
  int max_level = 3;                // finest level: edge root_size / 2^max_level, cells 1/16 of that
  int max_tiles = 4096;             // tiles of all levels in the pool
  int layers_per_tile = 208;        // layers in the pool, for each tile: a cell with data needs one or a few
  double min_sigma = 0.005;         // floor of one observation's standard deviation [m]
  double node_spacing_ratio = 0.7;  // a mesh's cells are no smaller than this times its point spacing
  double gate = 3.5;                // layers further apart than this many sigma are two surfaces
};

struct TileKey {
  std::int32_t north_index = 0, east_index = 0;
  std::int16_t level = 0;
};

// The onboard map: a quadtree over nav's north-east plane with tiles of 16 x 16 cells. A cell holds
// whole-numbered sums over the observations of meshes (weight, weight * height, weight * height^2, weight *
// colour, count). The observations depend on the mesh alone, so remove() subtracts exactly what fuse() added,
// and the map depends on the set of its meshes, not on the order of calls.
//
// A mesh is added at the level of its point spacing. Several levels can have sums over the same ground: the
// finest with data is shown, elsewhere the next coarser one is interpolated. The sums of a cell are separated
// by bins of height. When read, neighbouring bins that agree within the gate are one surface; of two surfaces
// the one with more observations is shown (of equals the upper), and the node is marked where the other has a
// third of that support. So a fish does not shift the floor, and disappears when it is outvoted.
//
// When the pool is full, the group of four squares of least value (flat, observed long ago, far from the
// vehicle, already sent) is added into its parent, which then takes all finer observations until it is empty.
// Meshes that were added at a finer level are still subtracted exactly. Two maps of the same meshes are equal
// bit by bit if both have coarsened the same squares, or none. A mesh is refused whole when there is no room
// even then. One thread at a time.
class QuadtreeMap {
 public:
  explicit QuadtreeMap(const QuadtreeConfig& config);  // throws std::invalid_argument; the only allocation
  ~QuadtreeMap();

  // Fuses a local mesh given in nav (vertices, sigma, colours): every cell with its middle under a triangle
  // gets one observation, weighted by 1 / sigma^2 (min_sigma where the mesh has no sigma). Triangles with
  // vertices that are not finite or further than 100 km from the origin are skipped. Returns the number of
  // cells observed; 0 when the mesh was refused.
  std::size_t fuse(const Mesh& mesh_in_nav);
  // Subtracts a mesh that was fused (not refused) with exactly these vertices, sigma and colours.
  std::size_t remove(const Mesh& mesh_in_nav);

  // Coarsens a square as a full pool does: adds the squares below it into it. False when nothing is below it,
  // or more than one level.
  bool coarsen(const TileKey& key);
  // For the value of areas: the vehicle's position, and squares that the ship has received as shown.
  void noteVehicle(const Eigen::Vector2d& north_east);
  void noteSent(const TileKey& key);

  // Empties the map, without calls of the heap. The next fuse() has the number `fused` + 1.
  void clear(std::uint32_t fused = 0);
  // Number of calls of fuse() and remove().
  [[nodiscard]] std::uint32_t fused() const;

  // Visits the squares that partition the observed area, ordered by level, north, east; with `finest`,
  // squares below that level are represented by their ancestor of that level. A leaf can be without own sums,
  // where a coarser square is shown beside a finer one. `revision`: number of the last fuse(), remove() or
  // coarsening that can have changed the leaf's extract().
  void forEachLeaf(const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  void forEachLeaf(int finest,
                   const std::function<void(const TileKey&, std::uint32_t revision)>& visit) const;
  // Any square of any level as heights at the corners of its cells: the mean of finer cells under a tent as
  // wide as the spacing, or coarser cells interpolated; false without data there. Unbiased on a plane, also
  // at the border of the data.
  [[nodiscard]] bool extract(const TileKey& key, HeightTile& out) const;

  // All sums as bytes in a fixed order: equal for equal maps, independent of their histories.
  [[nodiscard]] std::string canonicalBytes() const;

  struct Counters {
    std::uint64_t observations = 0;       // added: one for a cell and mesh
    std::uint64_t outvoted = 0;           // of those, not on the surface shown then
    std::uint64_t removed = 0;            // observations subtracted
    std::uint64_t missing = 0;            // to be subtracted, but never added: an error of the caller
    std::uint64_t coarsened = 0;          // groups of tiles replaced by their parent
    std::uint64_t refused = 0;            // meshes for which there was no room
    std::uint64_t skipped_triangles = 0;  // not finite, or too far
    int tiles_used = 0, tiles_high_water = 0;
    int layers_used = 0, layers_high_water = 0, layers = 0;
    std::size_t memory_bytes = 0;  // all that is held: pools, index, work space
  };
  [[nodiscard]] Counters counters() const;

  // Saves and restores bit by bit, for a map of the same configuration; a map is empty after a failed load().
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// All leaves as one mesh in nav without cracks: shared nodes of tiles are one vertex, and a cell beside finer
// ones has their vertices in its border.
[[nodiscard]] Mesh toMesh(const QuadtreeMap& map);
// The same without cells finer than a level's.
[[nodiscard]] Mesh meshAt(const QuadtreeMap& map, int level);

}  // namespace fathom::fusion

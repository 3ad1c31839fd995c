#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/tile_index.hpp"

namespace fathom::fusion {

// One mesh's observation of one cell.
struct CellObservation {
  std::uint64_t place = 0;   // of the cell: see MeshObservations
  std::int32_t height = 0;   // nav z [2^-13 m]
  std::uint16_t weight = 0;  // 1 to kMaxWeight
  Rgb colour{};

  [[nodiscard]] int level() const { return static_cast<int>(place >> 56); }
  [[nodiscard]] TileKey tile() const {
    constexpr std::int32_t kBias = 1 << 23, kMask = (1 << 24) - 1;
    return {static_cast<std::int32_t>((place >> 32) & kMask) - kBias,
            static_cast<std::int32_t>((place >> 8) & kMask) - kBias, static_cast<std::int16_t>(level())};
  }
  [[nodiscard]] int cell() const { return static_cast<int>(place & 0xFF); }  // 16 * northwards + eastwards
};
static_assert(sizeof(CellObservation) == 24);

// A mesh in nav as whole-numbered observations: a pure function of the mesh, so that the map can subtract
// them again. Cell (i, j) of a level covers [i, i + 1) x [j, j + 1) spacings and is observed where its middle
// is under a triangle. The level follows from the mesh's mean point spacing, and is coarser for larger
// triangles. Of surfaces over one another the upper one counts, which the camera saw. Observations are
// ordered by level, tile and cell.
class MeshObservations {
 public:
  // A mesh with more cells is observed a level coarser: 64 m^2 at 1/32 m.
  static constexpr std::size_t kMost = 65536;

  explicit MeshObservations(const QuadtreeConfig& config);

  // Valid until the next call. Triangles with vertices that are not finite or too far are skipped.
  std::span<const CellObservation> collect(const Mesh& mesh_in_nav);
  [[nodiscard]] std::size_t skippedTriangles() const { return skipped_; }  // by the last collect()
  [[nodiscard]] std::size_t memoryBytes() const { return found_.capacity() * sizeof(CellObservation); }

 private:
  [[nodiscard]] double spacing(int level) const;
  // Finest level with cells no smaller than the configured ratio of a point spacing [m].
  [[nodiscard]] int levelFor(double point_spacing) const;
  // False when there are more than kMost.
  bool collectAt(const Mesh& mesh, int finest);
  bool observe(const Mesh& mesh, const std::array<std::uint32_t, 3>& triangle, int finest);

  QuadtreeConfig config_;
  std::vector<CellObservation> found_;
  std::size_t skipped_ = 0;
};

}  // namespace fathom::fusion

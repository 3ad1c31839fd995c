#pragma once

#include <array>
#include <cstdint>

#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {

// The surface that a cell shows: neighbouring layers that agree are one surface; of several surfaces the one
// with most observations is shown, of equal ones the upper.
struct CellReading {
  std::uint32_t count = 0;  // observations of the surface; 0: none
  bool layered = false;     // a second surface has at least a third of its support
  double depth = 0;         // [m]
  double variance = 0;      // of depth: from the observations' variances and their scatter [m^2]
  std::array<float, 3> colour{};
  std::int32_t first_bin = 0, last_bin = 0;  // of the surface

  [[nodiscard]] bool seen() const { return count > 0; }
};

// `first`: the cell's first layer, or QuadtreeStore::kNone.
[[nodiscard]] CellReading readCell(const QuadtreeStore& store, int level, std::int32_t first);

// Compares the surface of a finer cell with that of a coarser level at its place. They are two surfaces if
// they differ by more than the gate, which includes a horizontal error of one coarser spacing.
enum class SurfaceVote {
  kStands,
  kLayered,   // another surface has at least a third of the support
  kOutvoted,  // another surface has more
};
[[nodiscard]] SurfaceVote vote(const QuadtreeStore& store, const CellReading& finer,
                               const CellReading& coarser, int coarser_level);

}  // namespace fathom::fusion

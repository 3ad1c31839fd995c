#pragma once

#include <array>
#include <cstdint>

#include "recon/fusion/quadtree_store.hpp"

namespace fathom::fusion {

// What a cell's layers say when they are read: neighbouring layers that agree are one surface; of several
// surfaces the one that more observations support is shown, of equal ones the upper.
struct CellReading {
  std::uint32_t count = 0;  // observations of the surface; 0: nothing was seen
  bool layered = false;     // a second surface has at least a third of its support
  double depth = 0;         // [m]
  double variance = 0;      // of depth: of the observations, and of their disagreement [m^2]
  std::array<float, 3> colour{};
  std::int32_t first_bin = 0, last_bin = 0;  // of the surface

  [[nodiscard]] bool seen() const { return count > 0; }
};

// `first`: the cell's first layer, or QuadtreeStore::kNone.
[[nodiscard]] CellReading readCell(const QuadtreeStore& store, int level, std::int32_t first);

// What becomes of the surface that a finer cell shows, after what a coarser level says about its place: they
// are two surfaces when they differ by more than the gate, a coarser spacing of sideways error
// included.
enum class Verdict {
  kStands,
  kLayered,   // another surface has at least a third of the support
  kOutvoted,  // another surface has more
};
[[nodiscard]] Verdict judge(const QuadtreeStore& store, const CellReading& finer, const CellReading& coarser,
                            int coarser_level);

}  // namespace fathom::fusion

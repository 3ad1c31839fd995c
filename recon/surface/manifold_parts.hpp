#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace fathom::surface {

// A triangle soup cut into manifold parts: every edge has one face on either side or is a border, and the
// faces around a vertex are one fan. Elsewhere vertices are doubled and pinned; the parts fit as long as
// pinned vertices do not move.
struct ManifoldParts {
  std::vector<std::uint32_t> original;                  // of a vertex of the parts
  std::vector<std::uint8_t> pinned;                     // the vertex is at a cut of the surface
  std::vector<std::array<std::uint32_t, 3>> triangles;  // in the old order, without those of fewer corners
  std::uint64_t cut_edges = 0, split_vertices = 0, dropped_triangles = 0;
};
[[nodiscard]] ManifoldParts manifoldParts(const std::vector<std::array<std::uint32_t, 3>>& triangles,
                                          std::size_t vertices);

}  // namespace fathom::surface

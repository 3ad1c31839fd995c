#pragma once

#include <array>
#include <cstdint>

namespace fathom::fusion {

// Triangles of the 256 sign patterns of a cell (Lorensen & Cline 1987), built by walking the surface's
// outline over the cell's faces. A face with two opposite inside corners cuts each off by itself; as that
// depends on the face alone, neighbouring cells agree and the surface has no cracks.
//
// Corner c stands at (c & 1, c >> 1 & 1, c >> 2 & 1). Bit c of a pattern: corner c is inside (negative
// distance).
class MarchingCubesTable {
 public:
  static constexpr int kEdges = 12;
  static constexpr int kMaxTriangles = 10;  // one loop over all edges, as a fan
  struct Edge {
    std::uint8_t from, to;  // corners; `from` is the lower end
    std::uint8_t axis;      // 0 x, 1 y, 2 z
  };
  struct Pattern {
    std::uint8_t triangles = 0;
    std::array<std::array<std::uint8_t, 3>, kMaxTriangles> edge{};  // counter-clockwise seen from outside
  };

  MarchingCubesTable();
  [[nodiscard]] const Pattern& pattern(unsigned signs) const { return patterns_[signs]; }
  [[nodiscard]] const Edge& edge(std::size_t index) const { return edges_[index]; }

 private:
  std::array<Edge, kEdges> edges_{};
  std::array<Pattern, 256> patterns_{};
};

}  // namespace fathom::fusion

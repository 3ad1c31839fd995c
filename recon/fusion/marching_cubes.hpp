#pragma once

#include <array>
#include <cstdint>

namespace fathom::fusion {

// Triangles of the 256 sign patterns of a cell (Lorensen & Cline 1987), built by walking the surface's
// outline over the cell's faces. On a face with two opposite inside corners the outline separates them; this
// depends on the face alone, so that neighbouring cells agree and the surface has no cracks. The loops are
// cut into triangles without diagonals in a face, where the neighbour could have the same: every edge has at
// most two triangles.
//
// Corner c is at (c & 1, c >> 1 & 1, c >> 2 & 1). Bit c of a pattern: corner c is inside (negative distance).
class MarchingCubesTable {
 public:
  static constexpr int kEdges = 12;
  static constexpr int kMaxTriangles = 10;  // one loop over all edges
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
  // Whether the two edges are in one face of the cell.
  [[nodiscard]] bool shareFace(std::uint8_t a, std::uint8_t b) const { return (faces_[a] & faces_[b]) != 0; }

 private:
  void makeEdges();
  void makePattern(unsigned signs);

  std::array<Edge, kEdges> edges_{};
  std::array<std::uint8_t, kEdges> faces_{};  // of an edge: bits of its two faces
  std::array<std::array<std::uint8_t, 8>, 8> edge_between_{};
  std::array<Pattern, 256> patterns_{};
};

}  // namespace fathom::fusion

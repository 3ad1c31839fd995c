#include "recon/fusion/marching_cubes.hpp"

#include <cassert>

namespace fathom::fusion {
namespace {

// Corners of the faces, counter-clockwise seen from outside the cell.
constexpr std::uint8_t kFaces[6][4] = {
    {0, 4, 6, 2},  // x = 0
    {1, 3, 7, 5},  // x = 1
    {0, 1, 5, 4},  // y = 0
    {2, 6, 7, 3},  // y = 1
    {0, 2, 3, 1},  // z = 0
    {4, 5, 7, 6},  // z = 1
};

}  // namespace

MarchingCubesTable::MarchingCubesTable() {
  std::array<std::array<std::uint8_t, 8>, 8> edge_between{};
  std::uint8_t count = 0;
  for (std::uint8_t axis = 0; axis < 3; ++axis) {
    for (std::uint8_t corner = 0; corner < 8; ++corner) {
      if (corner >> axis & 1) continue;
      const auto to = static_cast<std::uint8_t>(corner | 1 << axis);
      edge_between[corner][to] = edge_between[to][corner] = count;
      edges_[count++] = {corner, to, axis};
    }
  }
  for (unsigned signs = 0; signs < 256; ++signs) {
    const auto inside = [&](std::uint8_t corner) { return (signs >> corner & 1) != 0; };
    // On each face, from the edge where its outline enters the inside to the edge where it leaves. An edge is
    // entered on one of its two faces and left on the other, so `next` closes loops.
    constexpr std::uint8_t kNone = 255;
    std::array<std::uint8_t, kEdges> next;
    next.fill(kNone);
    for (const auto& face : kFaces) {
      for (int k = 0; k < 4; ++k) {
        if (inside(face[k]) || !inside(face[(k + 1) % 4])) continue;
        int last = k + 1;  // last inside corner of the run
        while (inside(face[(last + 1) % 4])) ++last;
        next[edge_between[face[k]][face[(k + 1) % 4]]] = edge_between[face[last % 4]][face[(last + 1) % 4]];
      }
    }
    Pattern& pattern = patterns_[signs];
    for (std::uint8_t start = 0; start < kEdges; ++start) {
      if (next[start] == kNone) continue;
      std::array<std::uint8_t, kEdges> loop{};
      std::size_t length = 0;
      for (std::uint8_t at = start; next[at] != kNone;) {
        loop[length++] = at;
        const std::uint8_t following = next[at];
        next[at] = kNone;
        at = following;
      }
      for (std::size_t k = 1; k + 1 < length; ++k) {
        assert(pattern.triangles < kMaxTriangles);
        pattern.edge[pattern.triangles++] = {loop[0], loop[k], loop[k + 1]};
      }
    }
  }
}

}  // namespace fathom::fusion

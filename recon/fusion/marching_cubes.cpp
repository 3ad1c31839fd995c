#include "recon/fusion/marching_cubes.hpp"

#include <cassert>
#include <cstddef>

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

// Cuts a loop of edges into triangles without diagonals in a face.
class LoopCut {
 public:
  LoopCut(const MarchingCubesTable& table, const std::array<std::uint8_t, MarchingCubesTable::kEdges>& loop,
          std::size_t length, MarchingCubesTable::Pattern& pattern)
      : table_(table), loop_(loop), length_(length), pattern_(pattern) {}

  // The part from vertex `first` to `last`, closed by their diagonal or, for the whole loop, side. False: not
  // possible; nothing was added.
  bool cut(std::size_t first, std::size_t last) {
    if (last - first < 2) return true;
    const std::uint8_t before = pattern_.triangles;
    for (std::size_t apex = first + 1; apex < last; ++apex) {
      if (!allowed(first, apex) || !allowed(apex, last)) continue;
      pattern_.edge[pattern_.triangles++] = {loop_[first], loop_[apex], loop_[last]};
      if (cut(first, apex) && cut(apex, last)) return true;
      pattern_.triangles = before;
    }
    return false;
  }

 private:
  [[nodiscard]] bool allowed(std::size_t a, std::size_t b) const {
    return b - a == 1 || b - a == length_ - 1 || !table_.shareFace(loop_[a], loop_[b]);
  }

  const MarchingCubesTable& table_;
  const std::array<std::uint8_t, MarchingCubesTable::kEdges>& loop_;
  std::size_t length_;
  MarchingCubesTable::Pattern& pattern_;
};

}  // namespace

MarchingCubesTable::MarchingCubesTable() {
  makeEdges();
  for (unsigned signs = 0; signs < 256; ++signs) makePattern(signs);
}

void MarchingCubesTable::makeEdges() {
  std::uint8_t count = 0;
  for (std::uint8_t axis = 0; axis < 3; ++axis) {
    for (std::uint8_t corner = 0; corner < 8; ++corner) {
      if (corner >> axis & 1) continue;
      const auto to = static_cast<std::uint8_t>(corner | 1 << axis);
      edge_between_[corner][to] = edge_between_[to][corner] = count;
      edges_[count++] = {corner, to, axis};
    }
  }
  for (std::size_t f = 0; f < 6; ++f)
    for (std::size_t k = 0; k < 4; ++k)
      faces_[edge_between_[kFaces[f][k]][kFaces[f][(k + 1) % 4]]] |= static_cast<std::uint8_t>(1U << f);
}

void MarchingCubesTable::makePattern(unsigned signs) {
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
      next[edge_between_[face[k]][face[(k + 1) % 4]]] = edge_between_[face[last % 4]][face[(last + 1) % 4]];
    }
  }
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
    const bool done = LoopCut(*this, loop, length, patterns_[signs]).cut(0, length - 1);
    assert(done);
    static_cast<void>(done);
  }
}

}  // namespace fathom::fusion

#pragma once

#include <cstddef>
#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"

namespace fathom::slam {

// Poses, measurements and blocks are counted by signed numbers: -1 is none.
[[nodiscard]] constexpr std::size_t at(std::int64_t index) {
  return static_cast<std::size_t>(index);
}

inline constexpr int kBlockSize = 6;  // unknowns of a pose

// 6 x 6 numbers, column by column.
struct alignas(32) Block {
  double v[kBlockSize * kBlockSize];

  double& operator()(int row, int column) { return v[column * kBlockSize + row]; }
  double operator()(int row, int column) const { return v[column * kBlockSize + row]; }
};

// Six Householder reflections that take [L W] to [L' 0], where L L^T + W W^T = L' L'^T and the diagonal of
// the lower triangular L' is positive: reflection i mixes column i of L with all columns of W. Hyperbolic
// ones (Rader & Steinhardt 1986) do it for L L^T - W W^T = L' L'^T.
struct Reflections {
  double v[kBlockSize][kBlockSize];  // its vector is (1, v)
  double tau[kBlockSize];            // negative: hyperbolic
};

// c += scale a.
void addBlock(Block& c, const Block& a, double scale);
// c += a^T b.
void addTransposedProduct(Block& c, const Block& a, const Block& b);
// a = L L^T, in place, upper part zero. A pivot below `least` is replaced by it; returns the number replaced.
int factorizeBlock(Block& a, double least);
// x <- L^-1 x and x <- L^-T x.
void solveLower(const Block& l, double* x);
void solveLowerTransposed(const Block& l, double* x);
// Reflections for L and W of the diagonal; L becomes L'. `sign` 1 adds W W^T, -1 takes it away; where that
// would leave less than a thousandth of a pivot's square, L stays as it is.
void reflect(Block& l, Block& w, double sign, Reflections& reflections);

// Loops over the blocks of a factor's column.
struct ColumnKernels {
  // y[row] -= block x, for all blocks; vectors of six numbers, x apart from them.
  void (*forward)(const Block* blocks, const int* rows, int count, const double* x, double* y);
  // The same for six such vectors at once, the columns of blocks.
  void (*forwardSix)(const Block* blocks, const int* rows, int count, const Block& x, Block* z);
  // x -= sum block^T y[row].
  void (*backward)(const Block* blocks, const int* rows, int count, const double* y, double* x);
  // to[place[row]] -= block b^T.
  void (*subtractProducts)(const Block* blocks, const int* rows, int count, const Block& b, const int* place,
                           Block* to);
  // block <- block L^-T, L lower triangular.
  void (*solveFromRight)(Block* blocks, int count, const Block& l);
  // [block w[row]] <- [block w[row]] times the reflections.
  void (*applyReflections)(Block* blocks, const int* rows, int count, const Reflections& reflections,
                           Block* w);
};
FATHOM_INSTRUCTION_SETS(const ColumnKernels&, ColumnKernels);

}  // namespace fathom::slam

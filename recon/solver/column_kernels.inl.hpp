// Included once for each instruction set, with FATHOM_KERNELS its namespace. Uses nothing inline from
// elsewhere, so that the linker cannot take another file's function from the AVX2 build.
#include "recon/solver/block_kernels.hpp"

namespace fathom::slam::FATHOM_KERNELS {
namespace {

// One column of a block. On a processor without vectors of four numbers the compiler takes two of two.
using Four = double __attribute__((vector_size(32)));
using Two = double __attribute__((vector_size(16)));
struct Column {
  Four a;
  Two b;
};

#define FATHOM_INLINE static inline __attribute__((always_inline))

FATHOM_INLINE void load(Column& x, const double* p) {
  __builtin_memcpy(&x.a, p, sizeof x.a);
  __builtin_memcpy(&x.b, p + 4, sizeof x.b);
}

FATHOM_INLINE void store(double* p, const Column& x) {
  __builtin_memcpy(p, &x.a, sizeof x.a);
  __builtin_memcpy(p + 4, &x.b, sizeof x.b);
}

FATHOM_INLINE void addTimes(Column& y, const Column& x, double s) {
  y.a += x.a * s;
  y.b += x.b * s;
}

// out -= block y, where y(j, c) is at y[down j + across c].
FATHOM_INLINE void subtractProduct(const double* block, const double* y, int down, int across, double* out) {
  Column x[kBlockSize];
  for (int j = 0; j < kBlockSize; ++j) load(x[j], block + kBlockSize * j);
  for (int c = 0; c < kBlockSize; ++c) {
    Column sum;
    load(sum, out + kBlockSize * c);
    for (int j = 0; j < kBlockSize; ++j) addTimes(sum, x[j], -y[down * j + across * c]);
    store(out + kBlockSize * c, sum);
  }
}

void forward(const Block* blocks, const int* rows, int count, const double* x, double* y) {
  for (int k = 0; k < count; ++k) {
    const double* block = blocks[k].v;
    double* to = y + kBlockSize * rows[k];
    Column sum, column;
    load(sum, to);
    for (int j = 0; j < kBlockSize; ++j) {
      load(column, block + kBlockSize * j);
      addTimes(sum, column, -x[j]);
    }
    store(to, sum);
  }
}

void forwardSix(const Block* blocks, const int* rows, int count, const Block& x, Block* z) {
  for (int k = 0; k < count; ++k) subtractProduct(blocks[k].v, x.v, 1, kBlockSize, z[rows[k]].v);
}

void backward(const Block* blocks, const int* rows, int count, const double* y, double* x) {
  Column sum[kBlockSize] = {};
  for (int k = 0; k < count; ++k) {
    const double* block = blocks[k].v;
    Column right, column;
    load(right, y + kBlockSize * rows[k]);
    for (int j = 0; j < kBlockSize; ++j) {
      load(column, block + kBlockSize * j);
      sum[j].a += column.a * right.a;
      sum[j].b += column.b * right.b;
    }
  }
  for (int j = 0; j < kBlockSize; ++j)
    x[j] -= ((sum[j].a[0] + sum[j].a[1]) + (sum[j].a[2] + sum[j].a[3])) + (sum[j].b[0] + sum[j].b[1]);
}

void subtractProducts(const Block* blocks, const int* rows, int count, const Block& b, const int* place,
                      Block* to) {
  for (int k = 0; k < count; ++k) subtractProduct(blocks[k].v, b.v, kBlockSize, 1, to[place[rows[k]]].v);
}

void solveFromRight(Block* blocks, int count, const Block& l) {
  double inverse[kBlockSize];
  for (int j = 0; j < kBlockSize; ++j) inverse[j] = 1 / l.v[kBlockSize * j + j];
  for (int k = 0; k < count; ++k) {
    double* block = blocks[k].v;
    Column x[kBlockSize];
    for (int j = 0; j < kBlockSize; ++j) {
      load(x[j], block + kBlockSize * j);
      for (int i = 0; i < j; ++i) addTimes(x[j], x[i], -l.v[kBlockSize * i + j]);
      x[j].a *= inverse[j];
      x[j].b *= inverse[j];
      store(block + kBlockSize * j, x[j]);
    }
  }
}

void applyReflections(Block* blocks, const int* rows, int count, const Reflections& r, Block* w) {
  double dot[kBlockSize][kBlockSize];
  for (int i = 0; i < kBlockSize; ++i)
    for (int c = 0; c < kBlockSize; ++c) dot[i][c] = r.tau[i] < 0 ? -r.v[i][c] : r.v[i][c];
  for (int k = 0; k < count; ++k) {
    double* block = blocks[k].v;
    double* other = w[rows[k]].v;
    Column x[kBlockSize];
    for (int c = 0; c < kBlockSize; ++c) load(x[c], other + kBlockSize * c);
    for (int i = 0; i < kBlockSize; ++i) {
      Column y, sum;
      load(y, block + kBlockSize * i);
      sum = y;
      for (int c = 0; c < kBlockSize; ++c) addTimes(sum, x[c], dot[i][c]);
      sum.a *= r.tau[i];
      sum.b *= r.tau[i];
      y.a -= sum.a;
      y.b -= sum.b;
      store(block + kBlockSize * i, y);
      for (int c = 0; c < kBlockSize; ++c) addTimes(x[c], sum, -r.v[i][c]);
    }
    for (int c = 0; c < kBlockSize; ++c) store(other + kBlockSize * c, x[c]);
  }
}

}  // namespace

const ColumnKernels& table() {
  static constexpr ColumnKernels kTable = {forward,          forwardSix,     backward,
                                           subtractProducts, solveFromRight, applyReflections};
  return kTable;
}

}  // namespace fathom::slam::FATHOM_KERNELS

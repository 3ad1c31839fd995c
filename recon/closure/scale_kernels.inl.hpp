// Included once for each instruction set, with FATHOM_KERNELS its namespace. Calls no inline function of
// another header: the linker could take its AVX2 build for other objects.
#include "recon/closure/scale_kernels.hpp"

namespace fathom::closure::scale::FATHOM_KERNELS {
namespace {

using FloatLanes = float __attribute__((vector_size(32)));
constexpr int kLanes = 8;

// Of floats anywhere in memory.
struct __attribute__((packed, may_alias)) LanesInMemory {
  FloatLanes lanes;
};

#define FATHOM_LANES(pointer) (reinterpret_cast<const LanesInMemory*>(pointer)->lanes)
#define FATHOM_STORE(pointer, value) (reinterpret_cast<LanesInMemory*>(pointer)->lanes = (value))

void blurAlong(const float* m, const float* w, int radius, int n, float* out) {
  int x = 0;
  for (; x + 2 * kLanes <= n; x += 2 * kLanes) {
    FloatLanes sum0 = w[0] * FATHOM_LANES(m + x), sum1 = w[0] * FATHOM_LANES(m + x + kLanes);
    for (int k = 1; k <= radius; ++k) {
      const float *before = m + x - k, *after = m + x + k;
      sum0 += w[k] * (FATHOM_LANES(before) + FATHOM_LANES(after));
      sum1 += w[k] * (FATHOM_LANES(before + kLanes) + FATHOM_LANES(after + kLanes));
    }
    FATHOM_STORE(out + x, sum0);
    FATHOM_STORE(out + x + kLanes, sum1);
  }
  for (; x < n; ++x) {
    float sum = w[0] * m[x];
    for (int k = 1; k <= radius; ++k) sum += w[k] * (m[x - k] + m[x + k]);
    out[x] = sum;
  }
}

void blurDown(const float* const* rows, const float* w, int radius, int n, float* out) {
  int x = 0;
  for (; x + 2 * kLanes <= n; x += 2 * kLanes) {
    const float* middle = rows[radius] + x;
    FloatLanes sum0 = w[0] * FATHOM_LANES(middle), sum1 = w[0] * FATHOM_LANES(middle + kLanes);
    for (int k = 1; k <= radius; ++k) {
      const float *above = rows[radius - k] + x, *below = rows[radius + k] + x;
      sum0 += w[k] * (FATHOM_LANES(above) + FATHOM_LANES(below));
      sum1 += w[k] * (FATHOM_LANES(above + kLanes) + FATHOM_LANES(below + kLanes));
    }
    FATHOM_STORE(out + x, sum0);
    FATHOM_STORE(out + x + kLanes, sum1);
  }
  for (; x < n; ++x) {
    float sum = w[0] * rows[radius][x];
    for (int k = 1; k <= radius; ++k) sum += w[k] * (rows[radius - k][x] + rows[radius + k][x]);
    out[x] = sum;
  }
}

#define FATHOM_MORE(a, b) ((a) > (b) ? (a) : (b))
#define FATHOM_LESS(a, b) ((a) < (b) ? (a) : (b))
// Of each second value from p on.
#define FATHOM_SECONDS(p) \
  __builtin_shufflevector(FATHOM_LANES(p), FATHOM_LANES((p) + kLanes), 0, 2, 4, 6, 8, 10, 12, 14)

// The arc tangent of up to 1 by the odd polynomial of least greatest error, in turns.
void gradients(const float* above, const float* row, const float* below, int n, float* strength,
               float* turn) {
  constexpr float kTurn = 0.159154943F;
  constexpr float k1 = 0.99978784F * kTurn, k3 = -0.32580840F * kTurn, k5 = 0.15557865F * kTurn,
                  k7 = -0.04432656F * kTurn, kTiny = 1e-20F;
#define FATHOM_GRADIENTS(Value)                                        \
  const Value ax = FATHOM_MORE(dx, -dx), ay = FATHOM_MORE(dy, -dy);    \
  const Value t = FATHOM_LESS(ax, ay) / (FATHOM_MORE(ax, ay) + kTiny); \
  const Value t2 = t * t;                                              \
  const Value octant = (((k7 * t2 + k5) * t2 + k3) * t2 + k1) * t;     \
  const Value quarter = ay > ax ? 0.25F - octant : octant;             \
  const Value half = dx < 0 ? 0.5F - quarter : quarter;                \
  const Value square = dx * dx + dy * dy, whole = dy < 0 ? 1 - half : half
  int i = 0;
  for (; i + kLanes <= n; i += kLanes) {
    const FloatLanes dx = FATHOM_SECONDS(row + 2 * i + 1) - FATHOM_SECONDS(row + 2 * i - 1),
                     dy = FATHOM_SECONDS(above + 2 * i) - FATHOM_SECONDS(below + 2 * i);
    FATHOM_GRADIENTS(FloatLanes);
    FATHOM_STORE(strength + i, square);
    FATHOM_STORE(turn + i, whole);
  }
  for (; i < n; ++i) {
    const float dx = row[2 * i + 1] - row[2 * i - 1], dy = above[2 * i] - below[2 * i];
    FATHOM_GRADIENTS(float);
    strength[i] = square;
    turn[i] = whole;
  }
  for (i = 0; i < n; ++i) strength[i] = __builtin_sqrtf(strength[i]);
#undef FATHOM_GRADIENTS
}

int extrema(const float* above, const float* row, const float* below, float quiet, int n, int* found) {
  using Masks = int __attribute__((vector_size(32)));
  using Pairs = long __attribute__((vector_size(32)));
  int count = 0, x = 0;
  for (; x + kLanes <= n; x += kLanes) {
    const FloatLanes v = FATHOM_LANES(row + x);
    FloatLanes most = FATHOM_LANES(row + x - 1), least = most;
    for (int k = 0; k < 7; ++k) {
      const float* const other = k == 0 ? row + 1 : (k < 4 ? above + k - 2 : below + k - 5);
      const FloatLanes o = FATHOM_LANES(other + x);
      most = FATHOM_MORE(most, o);
      least = FATHOM_LESS(least, o);
    }
    const Masks is = ((v > quiet) & (v >= most)) | ((v < -quiet) & (v <= least));
    const Pairs pairs = reinterpret_cast<Pairs>(is);
    if ((pairs[0] | pairs[1] | pairs[2] | pairs[3]) == 0) continue;
    for (int k = 0; k < kLanes; ++k)
      if (is[k] != 0) found[count++] = x + k;
  }
  for (; x < n; ++x) {
    const float v = row[x];
    float most = row[x - 1], least = most;
    for (int k = 0; k < 7; ++k) {
      const float o = (k == 0 ? row + 1 : (k < 4 ? above + k - 2 : below + k - 5))[x];
      most = FATHOM_MORE(most, o);
      least = FATHOM_LESS(least, o);
    }
    if ((v > quiet && v >= most) || (v < -quiet && v <= least)) found[count++] = x;
  }
  return count;
}

#undef FATHOM_SECONDS
#undef FATHOM_LESS
#undef FATHOM_MORE
#undef FATHOM_STORE
#undef FATHOM_LANES

}  // namespace

ScaleKernels table() {
  return {blurAlong, blurDown, gradients, extrema};
}

}  // namespace fathom::closure::scale::FATHOM_KERNELS

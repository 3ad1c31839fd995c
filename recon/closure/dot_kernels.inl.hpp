// Included once for each instruction set, with FATHOM_KERNELS its namespace. Calls no inline function of
// another header: the linker could take its AVX2 build for other objects.
#include "recon/closure/dot_kernels.hpp"

namespace fathom::closure::FATHOM_KERNELS {
namespace {

void dotProducts(const std::int16_t* x, int n, const std::int16_t* y, int m, float* out) {
  constexpr int kTogether = 4;  // columns that share the loads of one vector
  int j = 0;
  for (; j + kTogether <= m; j += kTogether) {
    const std::int16_t *y0 = y + static_cast<long>(kDotLength) * j, *y1 = y0 + kDotLength,
                       *y2 = y1 + kDotLength, *y3 = y2 + kDotLength;
    for (int i = 0; i < n; ++i) {
      const std::int16_t* a = x + static_cast<long>(kDotLength) * i;
      std::int32_t s0 = 0, s1 = 0, s2 = 0, s3 = 0;
      for (int k = 0; k < kDotLength; ++k) {
        s0 += a[k] * y0[k];
        s1 += a[k] * y1[k];
        s2 += a[k] * y2[k];
        s3 += a[k] * y3[k];
      }
      float* to = out + i + static_cast<long>(n) * j;
      to[0] = static_cast<float>(s0);
      to[n] = static_cast<float>(s1);
      to[2L * n] = static_cast<float>(s2);
      to[3L * n] = static_cast<float>(s3);
    }
  }
  for (; j < m; ++j) {
    const std::int16_t* b = y + static_cast<long>(kDotLength) * j;
    for (int i = 0; i < n; ++i) {
      const std::int16_t* a = x + static_cast<long>(kDotLength) * i;
      std::int32_t sum = 0;
      for (int k = 0; k < kDotLength; ++k) sum += a[k] * b[k];
      out[i + static_cast<long>(n) * j] = static_cast<float>(sum);
    }
  }
}

}  // namespace

DotProducts table() {
  return dotProducts;
}

}  // namespace fathom::closure::FATHOM_KERNELS

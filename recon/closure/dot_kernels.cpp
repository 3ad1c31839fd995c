#include "recon/closure/dot_kernels.hpp"

namespace fathom::closure {

namespace baseline {
void dotProducts(const std::int16_t*, int, const std::int16_t*, int, float*);
}
#ifdef FATHOM_HAVE_AVX2
namespace avx2 {
void dotProducts(const std::int16_t*, int, const std::int16_t*, int, float*);
}
#endif

DotProducts baselineDotProducts() {
  return &baseline::dotProducts;
}

DotProducts fastestDotProducts() {
#ifdef FATHOM_HAVE_AVX2
  if (__builtin_cpu_supports("avx2")) return &avx2::dotProducts;
#endif
  return &baseline::dotProducts;
}

}  // namespace fathom::closure

#include "recon/surface/kernels/blend_kernels.hpp"

namespace fathom::surface {

const BlendKernels& blendKernels() {
#ifdef FATHOM_SURFACE_AVX2
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  if (has_avx2) return avx2BlendKernels();
#endif
  return baselineBlendKernels();
}

}  // namespace fathom::surface

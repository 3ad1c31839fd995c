#include "recon/fusion/kernels/fusion_kernels.hpp"

namespace fathom::fusion {

namespace baseline {
const FusionKernels& table();
}
#ifdef FATHOM_HAVE_AVX2
namespace avx2 {
const FusionKernels& table();
}
#endif

const FusionKernels& baselineFusionKernels() {
  return baseline::table();
}

const FusionKernels& fastestFusionKernels() {
#ifdef FATHOM_HAVE_AVX2
  if (__builtin_cpu_supports("avx2")) return avx2::table();
#endif
  return baseline::table();
}

}  // namespace fathom::fusion

#define FATHOM_KERNELS avx2
#define FATHOM_KERNELS_NAME "avx2"
#include "recon/surface/kernels/blend_kernels.inl.hpp"

namespace fathom::surface {

const BlendKernels& avx2BlendKernels() {
  return avx2::table();
}

}  // namespace fathom::surface

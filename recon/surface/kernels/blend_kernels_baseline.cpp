#define FATHOM_KERNELS baseline
#define FATHOM_KERNELS_NAME "baseline"
#include "recon/surface/kernels/blend_kernels.inl.hpp"

namespace fathom::surface {

const BlendKernels& baselineBlendKernels() {
  return baseline::table();
}

}  // namespace fathom::surface

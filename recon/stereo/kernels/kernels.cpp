#include "recon/stereo/kernels/kernels.hpp"

#include <opencv2/core/utility.hpp>

namespace fathom::stereo {

namespace baseline {
const Kernels& table();
}
#ifdef FATHOM_HAVE_AVX2
namespace avx2 {
const Kernels& table();
}
#endif

const Kernels& baselineKernels() {
  return baseline::table();
}

const Kernels& fastestKernels() {
#ifdef FATHOM_HAVE_AVX2
  if (cv::checkHardwareSupport(CV_CPU_AVX2)) return avx2::table();
#endif
  return baseline::table();
}

}  // namespace fathom::stereo

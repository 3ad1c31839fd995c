// The table of one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set.
#ifdef __AVX2__
// OpenCV's header takes the set from these names when it is not built as a part of OpenCV.
#include <immintrin.h>
#define CV_CPU_DISPATCH_MODE AVX2
#define CV_SSE3 1
#define CV_SSSE3 1
#define CV_SSE4_1 1
#define CV_SSE4_2 1
#define CV_POPCNT 1
#define CV_AVX 1
#define CV_AVX2 1
#endif
#include <opencv2/core/hal/intrin.hpp>

#include "recon/stereo/kernels/kernels.hpp"

namespace fathom::stereo::FATHOM_KERNELS {
namespace {

// Whatever of cv this brings in exists once per set, in a namespace of its own.
using namespace cv;  // NOLINT

#include "recon/stereo/kernels/image_kernels.inl.hpp"
#include "recon/stereo/kernels/patch_kernels.inl.hpp"

}  // namespace

const Kernels& table() {
  static constexpr Kernels kTable{smoothRows,   halveRow,     gradientRow, tensorRow,
                                  harrisRow,    localMaxima,  samplePatch, patchMoments,
                                  makeTemplate, projectPatch, likeness,    searchSums};
  return kTable;
}

}  // namespace fathom::stereo::FATHOM_KERNELS

// The table of one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set.
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
  static constexpr Kernels kTable{FATHOM_KERNELS_NAME, smoothRows,  halveRow,    gradientRow,  tensorRow,
                                  harrisRow,           localMaxima, samplePatch, patchMoments, makeTemplate,
                                  projectPatch,        likeness,    searchSums};
  return kTable;
}

}  // namespace fathom::stereo::FATHOM_KERNELS

// Compiled with AVX2. OpenCV's header takes the set from these names when it is not built as a part of
// OpenCV.
#include <immintrin.h>
#define CV_CPU_DISPATCH_MODE AVX2
#define CV_SSE3 1
#define CV_SSSE3 1
#define CV_SSE4_1 1
#define CV_SSE4_2 1
#define CV_POPCNT 1
#define CV_AVX 1
#define CV_AVX2 1

#define FATHOM_KERNELS avx2
#define FATHOM_KERNELS_NAME "AVX2"
#include "recon/stereo/kernels/kernels.inl.hpp"

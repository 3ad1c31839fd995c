// Compiled with AVX2.
#define FATHOM_KERNELS avx2
#define FATHOM_KERNELS_NAME "AVX2"
#include "recon/fusion/kernels/fusion_kernels.inl.hpp"

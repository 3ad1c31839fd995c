#define FATHOM_KERNELS avx2
#define FATHOM_KERNELS_NAME "AVX2"
#include "recon/slam/column_kernels.inl.hpp"

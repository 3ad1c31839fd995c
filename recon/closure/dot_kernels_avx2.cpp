#define FATHOM_KERNELS avx2
#include "recon/closure/dot_kernels.inl.hpp"

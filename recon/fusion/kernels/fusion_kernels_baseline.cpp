#define FATHOM_KERNELS baseline
#define FATHOM_KERNELS_NAME "baseline"
#include "recon/fusion/kernels/fusion_kernels.inl.hpp"

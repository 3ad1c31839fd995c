#define FATHOM_KERNELS baseline
#define FATHOM_KERNELS_NAME "baseline"
#include "recon/stereo/kernels/kernels.inl.hpp"

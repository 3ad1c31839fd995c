#define FATHOM_KERNELS baseline
#include "recon/closure/dot_kernels.inl.hpp"

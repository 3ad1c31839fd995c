#define FATHOM_KERNELS baseline
#define FATHOM_KERNELS_NAME "baseline"
#include "recon/slam/column_kernels.inl.hpp"

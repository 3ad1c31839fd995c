#include "recon/topside/tiles/bc1/block_rows.hpp"

#define FATHOM_KERNELS bc1_baseline
#include "recon/topside/tiles/bc1/block_rows.inl.hpp"

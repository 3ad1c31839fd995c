#include "recon/topside/tiles/bc1/block_rows.hpp"

#define FATHOM_KERNELS bc1_avx2
#include "recon/topside/tiles/bc1/block_rows.inl.hpp"

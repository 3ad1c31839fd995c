#include "recon/topside/tiles/bc1/block_rows.hpp"

namespace fathom::topside {

namespace bc1_baseline {
CompressBlockRow blockRow();
}
#ifdef FATHOM_HAVE_AVX2
namespace bc1_avx2 {
CompressBlockRow blockRow();
}
#endif

CompressBlockRow baselineBlockRow() {
  return bc1_baseline::blockRow();
}

CompressBlockRow fastestBlockRow() {
#ifdef FATHOM_HAVE_AVX2
  if (__builtin_cpu_supports("avx2") != 0) return bc1_avx2::blockRow();
#endif
  return baselineBlockRow();
}

}  // namespace fathom::topside

#pragma once

#include "recon/products/exports/sparse_model.hpp"
#include "recon/topside/dive.hpp"

namespace fathom::topside {

// Of a dive that was localised and whose work is still there; nothing is made again but the matches between
// pairs, which no work file keeps: localisation's links, each registered once more about its own result.
// Points of pairs without features (poses that were given, --no-slam) are none. Colours are those of the
// corrected left image. Takes about 250 bytes a feature. Throws InputError for a dive without images, or
// whose stages are not there.
[[nodiscard]] SparseModel sparseModelOf(Dive& dive);

}  // namespace fathom::topside

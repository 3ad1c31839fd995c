#pragma once

#include "recon/calibration/self_calibration.hpp"
#include "recon/import/images/board_images.hpp"

namespace fathom::topside {

// What the pairs show in common: SIFT (Lowe 2004), matched between left and right
// of a pair and from pair to pair (the next three), each the other's best and clearly better
// than the second. Pairs in the order of findStereoFiles(); of more than `most`, a run of that many in the
// middle of the track. Images are read in parallel, with progress on stderr. Throws InputError, which names
// the file, for one that cannot be read or has another size than the first.
[[nodiscard]] calibration::RigTracks findTracks(const BoardImageOptions& options, std::size_t most);

}  // namespace fathom::topside

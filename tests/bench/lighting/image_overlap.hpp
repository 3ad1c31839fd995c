#pragma once

#include <cstddef>
#include <filesystem>

#include "recon/topside/report/overlap_colours.hpp"

namespace fathom::bench {

// How much a place's colour differs between neighbours of a folder of RGB images, as they came and corrected
// by a lighting model that learns them all, without ranges: for images of which nothing is known. Places are
// those of features (SIFT) that both show.
struct ImageOverlap {
  std::size_t images = 0, couples = 0, places = 0;  // couples: neighbours that could be registered
  topside::OverlapColours::Difference before, after;
};
[[nodiscard]] ImageOverlap measureOverlap(const std::filesystem::path& folder);

}  // namespace fathom::bench

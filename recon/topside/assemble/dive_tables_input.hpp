#pragma once

#include <vector>

#include "recon/products/tables/dive_track.hpp"
#include "recon/topside/dive.hpp"

namespace fathom::topside {

// The dive's track second by second: dead reckoning, moved as localisation moved the pairs before and after.
// Without navigation the pairs; a point without a pose stands between parts that nothing joins.
[[nodiscard]] std::vector<DiveTrackPoint> trackOf(Dive& dive, const FuseResult& fused, const WaterLog& water);
// The pairs that have a pose.
[[nodiscard]] std::vector<ImageRow> imageRowsOf(Dive& dive, const FuseResult& fused, const WaterLog& water);

}  // namespace fathom::topside

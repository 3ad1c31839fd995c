#pragma once

#include <vector>

#include "recon/topside/pieces/fused_pair.hpp"

namespace fathom::topside {

// For each pair, whether its footprint overlaps one taken more than a minute earlier or later: the vehicle
// came back.
[[nodiscard]] std::vector<bool> likelyCrossovers(const std::vector<FusedPair>& pairs);

}  // namespace fathom::topside

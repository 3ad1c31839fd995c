#pragma once

#include <cstdint>

#include "recon/geometry/stereo_feature_frame.hpp"

namespace fathom::sim {

// The root-SIFT descriptor (norm 512) that the surroundings of a landmark have in one view:
//   d = 512 |g| / ||g||,   g = M z + own + noise n,
// where z (kLatent normal numbers) and own (one for each of the 128) belong to the appearance, n to the view
// and the feature, and M is fixed. The few numbers z are why different surroundings may look somewhat alike,
// as real descriptors do; distances are those of root-SIFT on rendered seafloors (tests/bench). Same
// arguments, same bytes.
[[nodiscard]] RootSift descriptorOf(std::uint64_t appearance, std::uint64_t view_seed, std::uint64_t feature,
                                    float noise);

}  // namespace fathom::sim

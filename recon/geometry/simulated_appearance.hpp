#pragma once

#include <array>
#include <cstdint>

namespace fathom {

// As many bytes as a root-SIFT descriptor, whose norm is 512.
using SimulatedDescriptor = std::array<std::uint8_t, 128>;

// The descriptor that simulated surroundings have in one view:
//   d = 512 |g| / ||g||,   g = M z + own + noise n,
// where z (kLatent normal numbers) and own (one for each of the 128) belong to the appearance, n to the view
// and the feature, and M is fixed. The few numbers z are why different surroundings may look somewhat alike,
// as real descriptors do; distances are those of root-SIFT on rendered seafloors (tests/bench). Same
// arguments, same bytes.
[[nodiscard]] SimulatedDescriptor simulatedDescriptor(std::uint64_t appearance, std::uint64_t view_seed,
                                                      std::uint64_t feature, float noise);

}  // namespace fathom

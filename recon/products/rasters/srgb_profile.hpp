#pragma once

#include <cstdint>
#include <vector>

namespace fathom::topside {

// The colour space of all of Fathom's colours (IEC 61966-2-1) as an ICC profile, which tells programs that
// read a mosaic so. Always the same bytes.
[[nodiscard]] const std::vector<std::uint8_t>& srgbProfile();

}  // namespace fathom::topside

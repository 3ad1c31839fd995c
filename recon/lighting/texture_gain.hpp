#pragma once

#include <cstdint>

namespace fathom::lighting {

// Of an 8-bit grey image, rows without padding: by how much the texture of its ground must be pulled apart so
// that 8 bits show it. 1 for all but ground of little contrast in haze; no more than 16, which shows noise.
[[nodiscard]] float textureGain(const std::uint8_t* grey, int width, int height);

}  // namespace fathom::lighting

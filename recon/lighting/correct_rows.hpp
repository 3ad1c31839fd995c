#pragma once

#include <cstdint>

namespace fathom::lighting {

// Gain and offset from a sample (as stored) to a grey level of 8 bits.
struct Correction {
  float gain = 1.0F;
  float offset = 0.0F;
};

// One row of an image: out = gain * sample + offset, rounded and clamped to 0 to 255. `even` and `odd` are
// the corrections of the pixels in even and odd columns (a mono image: the same) at `nodes` nodes in the
// middles of as many equal cells; linear between them, and on to the row's ends.
template <typename T>
void correctRow(const T* in, int width, const Correction* even, const Correction* odd, int nodes,
                std::uint8_t* out);

// The same for rows of pixels of three interleaved samples.
template <typename T>
void correctRgbRow(const T* in, int width, const Correction* const (&channels)[3], int nodes,
                   std::uint8_t* out);

}  // namespace fathom::lighting

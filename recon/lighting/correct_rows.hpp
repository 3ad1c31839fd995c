#pragma once

#include <array>
#include <cstdint>

#include "recon/lighting/node_lattice.hpp"

namespace fathom::lighting {

// Gain and offset from a sample (as stored) to a grey level of 8 bits.
struct Correction {
  float gain = 1.0F;
  float offset = 0.0F;
};

// Columns of a row's nodes, in the middles of as many equal cells, and the pixels between each two of them.
struct RowPlan {
  RowPlan() = default;
  RowPlan(int row_width, int node_count);

  int width = 0, nodes = 0;                      // pixels, nodes
  float per_pixel = 0;                           // nodes
  std::array<float, NodeLattice::kMaxSide> x{};  // of a node [px]
  std::array<int, NodeLattice::kMaxSide> end{};  // of the stretch after a node [px]
};

// Output of a corrected value: the value itself in grey levels, or the level of sRGB for linear light from 0
// to 1 (IEC 61966-2-1 to half a level, two near black).
enum class Encoding : std::uint8_t { kLevels, kSrgb };

// One row of an image: out = gain * sample + offset, rounded and clamped to 0 to 255. `even` and `odd` are
// the corrections of the pixels in even and odd columns (a mono image: the same) at the nodes; linear between
// them, and on to the row's ends.
template <Encoding kEncoding, typename T>
void correctRow(const RowPlan& plan, const T* in, const Correction* even, const Correction* odd,
                std::uint8_t* out);

// The same for rows of pixels of three interleaved samples.
template <Encoding kEncoding, typename T>
void correctRgbRow(const RowPlan& plan, const T* in, const Correction* const (&channels)[3],
                   std::uint8_t* out);

}  // namespace fathom::lighting

#pragma once

#include <cstdint>
#include <vector>

namespace fathom::surface {

// A grid of colours, four values a place (the fourth unused), some of them unknown.
struct ColourGrid {
  int width = 0, height = 0;
  std::vector<float> values;        // 4 * width * height
  std::vector<std::uint8_t> known;  // width * height
};

// Gives every unknown place a colour that runs smoothly between the known ones around it: halved grids down
// to one place, each unknown place from between four of the next coarser grid (pull and push, Gortler et al.
// 1996). False, and nothing done, where no place is known.
bool fillSmoothly(ColourGrid& grid);

}  // namespace fathom::surface

#pragma once

#include <vector>

namespace fathom::surface {

struct Rectangle {
  int width = 0, height = 0;  // [texels]
  int x = 0, y = 0;           // where it was put
};

struct PackedSize {
  int width = 0, height = 0;
};

// Puts rectangles beside each other without overlap, on a skyline (Jylanki 2010, "bottom left"), in the width
// of a few that gives the least area. Sizes that are multiples of a number give places that are.
[[nodiscard]] PackedSize pack(std::vector<Rectangle>& rectangles);

}  // namespace fathom::surface

#pragma once

#include <cstddef>

namespace fathom::topside {

class Dive;

// How much the same place of the seafloor differs between two images that show it, from other ranges and
// angles: by images as they came, with one white balance of the whole dive, and by their corrected colours.
// Needs no truth. Medians over places.
struct OverlapColours {
  struct Difference {
    double luminance = 0;  // of linear light, over its mean
    double chroma = 0;     // CIE a*, b*
  };
  Difference before, after;
  std::size_t couples = 0, places = 0;  // couples of images; 0: nothing overlaps, or grey images
};

// Of neighbours along the track and of closures, kOverlapCouples each at most, evenly over the dive: left
// images are read again, two for each. After localisation.
inline constexpr std::size_t kOverlapCouples = 12;
[[nodiscard]] OverlapColours overlapColours(Dive& dive);

}  // namespace fathom::topside

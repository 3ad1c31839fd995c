#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/geometry/image_view.hpp"

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

// A place in two images, linear light; 8-bit RGB is taken to be sRGB.
struct PlaceColours {
  Eigen::Vector3d a, b;
};
// Mean of the square about a pixel that is a place, kPlaceReach to all sides, which must be in the image.
[[nodiscard]] Eigen::Vector3d colourAbout(const ImageView& image, const Eigen::Vector2d& pixel);
inline constexpr int kPlaceReach = 8;  // [px]
// After one gain for each channel that makes the mean of all places grey.
[[nodiscard]] OverlapColours::Difference differenceOf(const std::vector<PlaceColours>& places);

// Of neighbours along the track and of closures, kOverlapCouples each at most, evenly over the dive: left
// images are read again, two for each. After localisation.
inline constexpr std::size_t kOverlapCouples = 12;
[[nodiscard]] OverlapColours overlapColours(Dive& dive);

}  // namespace fathom::topside

#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::topside {

// A mesh in nav seen from straight above, north up, east to the right.
struct MapPicture {
  int width = 0, height = 0;  // [px]
  double metres_per_pixel = 0;
  double north = 0, west = 0;             // of the top left corner [m]
  double shallowest = 0, deepest = 0;     // ends of the colour scale: 1st and 99th percentile of depth [m]
  std::vector<std::uint8_t> rgb;          // depth as colour, shaded by light from the north-west
  std::vector<std::uint8_t> rgb_texture;  // the mesh's own colours, shaded alike
};

// What must be known of a mesh before it is drawn; it may come in parts.
class MapExtent {
 public:
  void add(const Mesh& part);  // vertices, each in one part
  [[nodiscard]] bool empty() const { return depths_.empty(); }
  [[nodiscard]] const Eigen::Array2d& low() const { return low_; }  // north, east [m]
  [[nodiscard]] const Eigen::Array2d& high() const { return high_; }
  [[nodiscard]] double depthAt(std::size_t percent) const;  // percentile [m]

 private:
  Eigen::Array2d low_ = Eigen::Array2d::Constant(INFINITY), high_ = Eigen::Array2d::Constant(-INFINITY);
  std::map<float, std::size_t> depths_;  // vertices at each: on the tiles' lattice, so few differ
  std::size_t vertices_ = 0;
};

// Draws that mesh: all triangles by add(), in parts too, then take(). At most `max_pixels` along the longer
// side, no finer than `min_metres` a pixel. Nothing gives an empty picture.
class MapPainter {
 public:
  MapPainter(const MapExtent& extent, int max_pixels, double min_metres);
  void add(const Mesh& part);
  [[nodiscard]] MapPicture take();

 private:
  struct Seen {
    float depth = INFINITY;
    float shade = 0;
    std::array<float, 3> colour{};
  };
  MapPicture picture_;
  std::vector<Seen> seen_;  // uppermost surface at each pixel's middle
};

// PNG bytes of such pixels. Throws std::runtime_error when they cannot be encoded.
[[nodiscard]] std::string toPng(const std::vector<std::uint8_t>& rgb, int width, int height);

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

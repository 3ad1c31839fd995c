#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/surface/atlas.hpp"
#include "recon/surface/band_image.hpp"

namespace fathom::surface {

// One image that may show a surface.
struct View {
  std::uint32_t image = 0;  // the caller's number of it
  SE3 T_nav_cam;
  std::array<double, 4> footprint{};  // plan box of its ground: north, east low, then high [m]
  std::uint32_t camera = 0;           // index of its camera in the blender
};

// Views by their footprints: a bounding-volume hierarchy, split at the median of the longer side.
class ViewIndex {
 public:
  explicit ViewIndex(std::vector<View> views);
  // Indices in the constructor's list, ascending, of the views with footprints that meet the box
  // {north low, east low, north high, east high}. A footprint that is not finite meets nothing.
  [[nodiscard]] std::vector<std::uint32_t> meeting(const std::array<double, 4>& box) const;
  [[nodiscard]] const std::vector<View>& views() const { return views_; }

 private:
  struct Node {
    std::array<double, 4> box{};
    std::uint32_t first = 0, count = 0;  // of order_; leaves only
    std::uint32_t right = 0;  // inner nodes: place of the second child; the first follows its parent
  };
  std::uint32_t build(std::uint32_t first, std::uint32_t count);

  std::vector<View> views_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

enum class BlendMode : std::uint8_t {
  kBands,      // three bands, each with its own weights
  kAverage,    // plain mean of all views
  kUnblended,  // the best view's pixel
};

struct BlendConfig {
  BlendMode mode = BlendMode::kBands;
  std::array<double, 3> sharpness = {5, 10, 50};  // k of low, middle and high band (eq. 1 and 2)
  BandWidths bands;                               // widths of the low passes between them
  bool vote = true;                               // reject views that the others contradict
  double tolerance = 0.015;  // a point this far behind the nearest surface is still visible [m]
  // Most views of a place that are used, the most central ones.
  int views_of_a_place = 12;
};

constexpr std::uint32_t kNoView = 0xffffffff;

struct BlendCounts {
  std::uint64_t texels = 0, unseen = 0, occluded = 0, outvoted = 0, samples = 0;
  std::uint32_t views = 0;
};

// Texture of one tile from the images that saw it, after Johnson-Roberson et al. 2010 (band-limited blending,
// equations 1 and 2; Burt & Adelson 1983):
//   texel = sum over bands b of  sum over views i of w_b(r_i) B_b,i / sum over views i of w_b(r_i),
//   w_b(r) = exp(-k_b r),  r = distance of the projected point from the image's centre (1 in the corners),
//                          plus 1 - z_min / z for the loss of resolution at the view's range z against the
//                          nearest view's (twice the range counts as half the distance to the corner),
// with disjoint bands B = G(s2), G(s1) - G(s2), I - G(s1). A factor common to all bands falls to 0 at the
// image's border, beside hidden parts and for faces seen edge-on, so that no view begins or ends with a step.
// A view counts for a texel when its camera sees the point: inside the image, not hidden by its mask, facing,
// and without `occluders` in between. Moving objects are rejected by a vote where three or more views see a
// place and one differs by more than their spread. Texels without a view, gutters and the space between
// charts take their neighbours' colours. One object a thread; it keeps its memory. The result does not depend
// on the instruction set.
class TextureBlender {
 public:
  // For one camera, with images reduced by config.bands.
  TextureBlender(const Camera& camera, const BlendConfig& config);
  // Several, numbered by views: as their images are in the bands, reduced.
  TextureBlender(std::vector<Camera> cameras, const BlendConfig& config);
  ~TextureBlender();

  // The corrected 8-bit RGB image of a view (its camera's size), or null if unavailable. Called once for a
  // view and tile; the image must stay until blend() returns.
  using ImageSource = std::function<const RgbImage*(std::uint32_t image)>;
  // The same with its bands, from makeBands(image, config.bands), for callers that keep them for several
  // tiles; null if unavailable.
  using BandSource = std::function<std::shared_ptr<const BandImage>(std::uint32_t image)>;

  // Fills atlas.tile.atlas. `views`: places in `index`. `occluders`: the surface of the tile and around it.
  BlendCounts blend(Atlas& atlas, const ViewIndex& index, const std::vector<std::uint32_t>& views,
                    const std::vector<const Mesh*>& occluders, const BandSource& images);
  BlendCounts blend(Atlas& atlas, const ViewIndex& index, const std::vector<std::uint32_t>& views,
                    const std::vector<const Mesh*>& occluders, const ImageSource& images);

  // After a blend() in kUnblended: which view a texel shows (its place in the index), row by row; kNoView
  // where none.
  [[nodiscard]] const std::vector<std::uint32_t>& chosen() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::surface

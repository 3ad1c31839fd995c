#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/rgb_image.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/surface/atlas.hpp"
#include "recon/surface/band_image.hpp"
#include "recon/surface/view_index.hpp"

namespace fathom::surface {

enum class BlendMode : std::uint8_t {
  kBands,      // three bands, each with its own weights
  kAverage,    // plain mean of all views
  kUnblended,  // the best view's pixel
};

struct BlendConfig {
  BlendMode mode = BlendMode::kBands;
  std::array<double, 3> sharpness = {5, 10, 50};  // k of low, middle and high band (eq. 1 and 2)
  BandWidths bands;                               // what divides the bands
  bool vote = true;                               // leave out views that the others contradict
  double tolerance = 0.015;  // behind the nearest surface by less than this is still seen [m]
  // Of the views that see a place at most so many are used, the most central ones.
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
//                          and beyond it what the ground's resolution costs: 1 - z_min / z of the view's
//                          range z and the nearest view's, so that twice as far counts as half the way to the
//                          corner,
// with bands that do not overlap: B = G(s2), G(s1) - G(s2), I - G(s1). To that comes a factor common to all
// bands that falls to 0 at the image's border, at the edge of what is hidden and for faces seen edge-on, so
// that no view begins or ends with a step. A view counts for a texel when its camera sees the point: inside
// the image, not hidden by its mask, facing, and nothing of `occluders` in between. Moving things are voted
// out where three or more views see a place and one differs by more than their spread. Texels that no view
// sees take their neighbours' colours, and so do the gutters and the room between charts. One object a
// thread; it keeps its memory. The result does not depend on the instruction set.
class TextureBlender {
 public:
  // One whose images are reduced as config.bands says.
  TextureBlender(const Camera& camera, const BlendConfig& config);
  // Several, numbered by views: as their images are in the bands, reduced.
  TextureBlender(std::vector<Camera> cameras, const BlendConfig& config);
  ~TextureBlender();

  // The corrected 8-bit RGB image of a view (its camera's size), or null where it cannot be had. It is asked
  // for once a view and tile, and must stay until blend() returns.
  using ImageSource = std::function<const RgbImage*(std::uint32_t image)>;
  // The same with its bands, made by makeBands(image, config.bands) and kept by whoever uses an image for
  // several tiles; null where it cannot be had.
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

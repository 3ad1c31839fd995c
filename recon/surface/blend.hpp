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

namespace fathom::surface {

// One image that may have seen a surface.
struct View {
  std::uint32_t image = 0;  // the caller's number of it
  SE3 T_nav_cam;
  std::array<double, 4> footprint{};  // north, east low, then high, of what it saw [m]
};

// Views by their footprints: a bounding-volume hierarchy.
class ViewIndex {
 public:
  explicit ViewIndex(std::vector<View> views);
  // Numbers (places in the constructor's list, ascending) of views whose footprints meet the box
  // {north low, east low, north high, east high}.
  [[nodiscard]] std::vector<std::uint32_t> meeting(const std::array<double, 4>& box) const;
  [[nodiscard]] const std::vector<View>& views() const { return views_; }

 private:
  struct Node;
  std::vector<View> views_;
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
  std::array<double, 2> band_px = {4, 16};        // widths that divide the bands [image px]
  bool vote = true;                               // leave out views that the others contradict
};

struct BlendCounts {
  std::uint64_t texels = 0, unseen = 0, occluded = 0, outvoted = 0, samples = 0;
  std::uint32_t views = 0;
};

// Texture of one tile from the images that saw it, after Johnson-Roberson et al. 2010 (section on
// band-limited blending, equations 1 and 2; Burt & Adelson 1983): non-overlapping bands, weights by the
// distance of the projected point from the image's centre. A view counts for a texel when its camera sees the
// point: inside the image, facing, and nothing of `occluders` in between. Moving things are voted out where
// three or more views see a place and one differs by more than their spread. One object a thread; it keeps
// its memory.
class TextureBlender {
 public:
  TextureBlender(const Camera& camera, const BlendConfig& config);
  ~TextureBlender();

  // The corrected 8-bit RGB image of a view (rig's size), or null where it cannot be had. It is asked for
  // once a view and tile, and must stay until the next call.
  using ImageSource = std::function<const RgbImage*(std::uint32_t image)>;

  // Fills atlas.tile.atlas. `views`: places in `index`. `occluders`: the surface of the tile and around it.
  BlendCounts blend(Atlas& atlas, const ViewIndex& index, const std::vector<std::uint32_t>& views,
                    const std::vector<const Mesh*>& occluders, const ImageSource& images);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::surface

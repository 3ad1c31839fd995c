#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recon/geometry/se3.hpp"

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

}  // namespace fathom::surface

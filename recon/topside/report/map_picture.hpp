#pragma once

#include <cstdint>
#include <string>
#include <vector>

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

// At most `max_pixels` along the longer side, no finer than `min_metres` a pixel. An empty mesh gives an
// empty picture.
[[nodiscard]] MapPicture drawFromAbove(const Mesh& mesh, int max_pixels, double min_metres);

// PNG bytes of such pixels. Throws std::runtime_error when they cannot be encoded.
[[nodiscard]] std::string toPng(const std::vector<std::uint8_t>& rgb, int width, int height);

}  // namespace fathom::topside

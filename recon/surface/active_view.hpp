#pragma once

#include <memory>

#include "recon/surface/band_image.hpp"
#include "recon/surface/depth_buffer.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {

// A view while its tile is being textured.
struct ActiveView {
  std::uint32_t place = 0;  // in the index
  ViewProjection projection;
  DepthBuffer depth;
  std::shared_ptr<const BandImage> bands;
  float fade = 0;  // over which its weight rises from the image's border and from what is hidden [px]
};

}  // namespace fathom::surface

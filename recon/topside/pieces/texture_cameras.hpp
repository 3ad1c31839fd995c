#pragma once

#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/surface/band_image.hpp"

namespace fathom::topside {

// A camera whose images are texture.
struct TextureCamera {
  std::size_t number = 0;  // of MissionInput
  Camera camera;           // as its images are in `bands`
  SE3 T_left_cam;
  surface::BandWidths bands;
};

}  // namespace fathom::topside

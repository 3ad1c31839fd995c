#pragma once

#include <array>

#include "recon/geometry/camera.hpp"

namespace fathom::topside {

// A lens of OpenCV's rational model, as its sample stereo_calib.cpp fits it,
//   r' = r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),
// as one without the denominator: k1, k2 and k3 of the camera are changed to the least squares fit between
// the principal point and the farthest corner of the image; of one without a size, a tenth over twice as
// large as the principal point is far from (0, 0). Gives the largest difference there [px]; infinity for a
// lens that folds within the image.
[[nodiscard]] double fitRationalLens(Camera& camera, const std::array<double, 3>& denominator);

}  // namespace fathom::topside

#pragma once

#include <Eigen/Core>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// sRGB (IEC 61966-2-1), 0 to 1, to linear light.
[[nodiscard]] double linearFromSrgb(double srgb);
// Linear, 0 to 1 (CIE Y).
[[nodiscard]] double luminanceOf(const Rgb& srgb);
// CIE L*a*b* (D65, 2 degrees) of linear sRGB, 0 to 1.
[[nodiscard]] Eigen::Vector3d labOf(const Eigen::Vector3d& linear);
// CIEDE2000, after Sharma, Wu and Dalal 2005, "The CIEDE2000 color-difference formula", Color Res. Appl. 30.
[[nodiscard]] double ciede2000(const Eigen::Vector3d& lab_a, const Eigen::Vector3d& lab_b);

}  // namespace fathom

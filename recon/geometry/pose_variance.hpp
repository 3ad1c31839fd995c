#pragma once

#include <array>
#include <span>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom {

// A camera that saw ground within a plan box (north and east of its low corner, then of its high one [m]),
// with the covariance of its pose's right perturbation (rho, phi) [m, rad].
struct UncertainView {
  SE3 T_nav_cam;
  Matrix6d covariance = Matrix6d::Zero();
  std::array<double, 4> box{};
};

// Adds to sigma of every vertex of a mesh in nav, with normals, what the doubt of the poses adds to that of
// the surface which they place. A camera with covariance C moves its point p, in the camera's frame, along
// the unit normal n by
//   a' rho + (p x a)' phi,  a = R' n,
// so with the variance of that row through C. Views of one spot share nearly all of it (navigation places
// them together): what is added is the mean over them, and does not fall with their number. Vertices that no
// view takes in stay as they are.
void addPoseVariance(std::span<const UncertainView> views, Mesh& mesh);

}  // namespace fathom

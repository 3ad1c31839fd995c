#pragma once

#include "recon/closure/agreement.hpp"
#include "recon/closure/registration.hpp"

// Rules by which a place is recognised of which nothing is known but how it looks: PlaceIndex proposes a pair
// of frames, a Registrar of these rules finds its pose without prior, the pose must fit what even a lost
// vehicle knows, and several such pairs must agree (agreement.hpp).
namespace fathom::closure {

// Stricter than where a prior helps: of the features that both frames should see, of their number, and of
// chance.
[[nodiscard]] RegistrationConfig recognitionRules();

// Whether the pose leaves down where it is and the camera as deep as it is: tilt and depth are measured
// absolutely, whatever became of position and heading. Poses in nav, of which only down and depth count.
[[nodiscard]] bool fitsDownAndDepth(const SE3& T_nav_a, const SE3& T_nav_b, const SE3& T_a_b);

// Of a registration without prior. `radius`: of the frames' footprints [m].
[[nodiscard]] Claim recognitionOf(int a, int b, const UncertainPose& found, int inliers, double radius);

}  // namespace fathom::closure

#pragma once

#include "recon/geometry/mesh.hpp"

namespace fathom::surface {

// Bound of the greatest distance from any point of `from` to `to` [m]: never less, and as a rule more by no
// more than `tolerance` or a twentieth. Each triangle is cut into the parts that lie over one face of `to`
// (walking from face to face); over such a part the distance to that face is greatest at a corner, as it is a
// convex function. A part that seems too far is divided until its nearest faces decide. 0 where `from` is
// empty, infinite where only `to` is.
[[nodiscard]] double distanceBound(const Mesh& from, const Mesh& to, double tolerance);

}  // namespace fathom::surface

#pragma once

#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// A factor for each vertex: 1 inside, falling linearly to a small floor at the mesh's border over `width` [m]
// (along edges), so that where range meshes end they blend into what others saw (Curless & Levoy 1996,
// section 3.1).
[[nodiscard]] std::vector<float> borderWeights(const Mesh& mesh, double width);

}  // namespace fathom::fusion
